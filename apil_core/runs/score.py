"""Score an adversary during its training."""

from __future__ import annotations

import copy
from contextlib import closing

import torch

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import parallel_games, score
from apil_core.policies.loading import run_victim
from apil_core.training.build import adversary_policy, observing_alone
from apil_core.training.trainer import Trainer


def score_in_training(
    trainer: Trainer,
    episodes: int,
    progress: Progress,
    name: str = "",
    sha256: str = "in memory",
    seed: int | None = None,
    adversary: Policy | None = None,
) -> EvaluationResult:
    """Score a trainer's adversary (or another) without changing the training games or their randomness.

    Methods are rebuilt from their state, so that their per-step state is separate.

    Args:
        trainer: of the run.
        episodes: number of games.
        progress: receives the number of games played.
        name, sha256: identity of the adversary, for the result.
        seed: of the games and all draws; default: the run's.
        adversary: scored instead.
    """
    config, layout, side = trainer.config, trainer.layout, trainer.adversary_side
    seed = config.seed if seed is None else seed
    seat = layout.sides[side]
    name = name or f"run at {trainer.steps} steps"
    info = PolicyInfo(name, sha256, seat.observation_size, seat.action_size)
    with (
        torch.random.fork_rng(devices=[]),
        closing(parallel_games(config, episodes, trainer.plugins)) as game,
    ):
        victim = run_victim(config, game, trainer.plugins, seed)
        if adversary is None:
            state = copy.deepcopy(trainer.policy_state())
            own = adversary_policy(state, info, config, game.layout, side, trainer.plugins, seed)
            pairing = Pairing(config, game, own, victim, side, own.hooks, trainer.steps)
        else:
            hooks = observing_alone(config, game.layout, side, trainer.plugins)
            pairing = Pairing(config, game, adversary, victim, side, hooks)
        result = score(pairing, episodes=episodes, seed=seed, progress=progress)
    if adversary is None:
        trainer.hook.evaluation_finished(run=trainer, result=result.model_dump(mode="json"))
    return result
