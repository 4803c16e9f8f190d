"""Dry run: build everything, run it for some seconds, estimate the cost, and write nothing."""

from __future__ import annotations

import io
import json
import shutil
import time
from collections.abc import Iterator
from contextlib import closing
from math import ceil
from pathlib import Path

import torch
from pydantic import BaseModel

from apil_core.api.config import RunConfig
from apil_core.common.torch_threads import one_torch_thread
from apil_core.config.resolve import complete
from apil_core.evaluation.progress import Progress
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.loading import load_victim
from apil_core.runs.runner import prepared
from apil_core.runs.score import score_in_training
from apil_core.training.build import build
from apil_core.training.distributed.world import ALONE
from apil_core.training.trainer import Trainer

_STEPS = 32
"""Steps per game in a measured iteration: enough for stable times, few enough to be quick."""
_GAMES = 32
"""Games played to measure the time of one."""


class Budget(BaseModel):
    """Composition of a run and its estimated cost on this machine at its present load.

    Attributes:
        victim, victim_sha256: name and hash of the victim.
        victim_side, adversary_side: names of the seats.
        parameters: of the adversary's networks, critics included.
        steps, iterations: of training.
        steps_per_second: measured in one iteration, shortened.
        evaluations: during training.
        games: scored, those at the end included.
        training_hours, scoring_hours: scoring is measured in games of a random adversary, so it is a guess.
        disk_mb: checkpoints and metrics.
        disk_free_mb: where the run directory would be.
    """

    method: str
    env: str
    device: str
    victim: str
    victim_sha256: str
    victim_side: str
    adversary_side: str
    parameters: int
    steps: int
    iterations: int
    steps_per_second: float
    evaluations: int
    games: int
    training_hours: float
    scoring_hours: float
    disk_mb: float
    disk_free_mb: float


@one_torch_thread()
def dry_run(config: RunConfig, plugins: PluginRegistry, place: Path = Path()) -> Budget:
    """Build game, victim, methods and networks on their device, check that they fit, and measure.

    Args:
        config: the run's.
        plugins: registry in which its names are looked up.
        place: where the run directory would be.

    Raises:
        ApilError: the run could not start.
    """
    config = complete(config, plugins)
    trainer, _ = prepared(shortened(config), plugins, ALONE)
    with closing(trainer):
        metrics, steps = _second_iteration(trainer)
        rate, attack, scoring = metrics["steps_per_second"], trainer.attack, config.evaluation
        # games of other rollouts count as steps, too, in proportion
        steps_each = steps * config.ppo.num_steps / trainer.config.ppo.num_steps
        iterations = ceil(config.steps / steps_each)
        evaluations = min(config.steps // scoring.every_steps, iterations) if scoring.every_steps else 0
        games = scoring.episodes + evaluations * scoring.periodic_episodes
        sides, learner = attack.game.layout.sides, trainer.attack.learner.state_dict()
        torch.save(trainer.state_dict(), kept := io.BytesIO())
        checkpoints = config.checkpoint.keep + 1 + bool(evaluations)
        rows = min(iterations, config.log_rows) + evaluations
        bytes_on_disk = checkpoints * kept.tell() + rows * len(json.dumps(metrics)) * len(config.recorders)
        return Budget(
            method=config.method,
            env=config.env,
            device=trainer.config.device,
            victim=trainer.config.victim,
            victim_sha256=trainer.config.victim_sha256,
            victim_side=sides[1 - attack.adversary_side].name,
            adversary_side=sides[attack.adversary_side].name,
            parameters=sum(tensor.numel() for tensor in _weights(learner)),
            steps=config.steps,
            iterations=iterations,
            steps_per_second=rate,
            evaluations=evaluations,
            games=games,
            training_hours=config.steps / rate / 3600,
            scoring_hours=games * _seconds_per_game(trainer) / 3600 if games else 0.0,
            disk_mb=bytes_on_disk / 1e6,
            disk_free_mb=shutil.disk_usage(_existing(place)).free / 1e6,
        )


def steps_per_second(config: RunConfig, plugins: PluginRegistry) -> float:
    """Measure the training speed of such a run at the machine's present load."""
    trainer = Trainer(build(shortened(config), plugins), plugins)
    with closing(trainer), one_torch_thread():
        return _second_iteration(trainer)[0]["steps_per_second"]


def shortened(config: RunConfig) -> RunConfig:
    """Return the same configuration with rollouts of a few steps, or of two samples for each minibatch."""
    steps = max(_STEPS, ceil(2 * config.ppo.minibatches / config.num_envs))
    ppo = config.ppo.model_copy(update={"num_steps": min(steps, config.ppo.num_steps)})
    return config.model_copy(update={"ppo": ppo})


def _second_iteration(trainer: Trainer) -> tuple[dict[str, float], int]:
    """Return the metrics and steps of the second iteration; the first one warms up."""
    trainer.iterate()
    before = trainer.steps
    return trainer.iterate(), trainer.steps - before


def _seconds_per_game(trainer: Trainer) -> float:
    config, side = trainer.config, trainer.adversary_side
    adversary = load_victim("random", trainer.attack.game, side, config.device, trainer.plugins)
    begin = time.perf_counter()
    score_in_training(trainer, _GAMES, Progress(), adversary=adversary)
    return (time.perf_counter() - begin) / _GAMES


def _weights(state: object) -> Iterator[torch.Tensor]:
    """Yield the network tensors in a learner's state; skip the optimisers'."""
    if isinstance(state, torch.Tensor):
        yield state
    elif isinstance(state, dict):
        for key, value in state.items():
            if "optimizer" not in str(key):
                yield from _weights(value)


def _existing(place: Path) -> Path:
    place = place.absolute()
    return next(path for path in (place, *place.parents) if path.is_dir())
