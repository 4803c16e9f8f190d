"""Score a victim against each of its opponents separately."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import torch
from pydantic import BaseModel

from apil_core.common.documents import EXACT
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, PolicyId
from apil_core.evaluation.score import evaluate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.runs.retraining.config import RetrainConfig


def score_each(
    config: RetrainConfig, victim: str, episodes: int, progress: Progress, plugins: PluginRegistry
) -> dict[str, EvaluationResult]:
    """By label, scores as of ``apil eval OPPONENT --victim VICTIM``: wins are the opponent's.

    The players are loaded separately, so no generator of the training is used.

    Args:
        config: the retraining's, with full names.
        victim: name of the policy to score against.
        episodes: games against each.
        progress: gets the number of games played.
        plugins: registry in which names are looked up.
    """
    names = [*config.adversaries, *([config.baseline] if config.baseline else [])]
    found = {}
    for label, name in zip(config.labels, names, strict=True):
        with torch.random.fork_rng(devices=[]):
            found[label] = evaluate(
                name,
                episodes=episodes,
                seed=config.seed,
                progress=progress,
                env=config.env,
                victim=victim,
                adversary_actions=config.evaluation.adversary_actions,
                victim_actions=config.evaluation.victim_actions,
                game_options=config.game,
                threads=config.threads,
                device=config.device,
                plugins=plugins,
                trust=config.trust,
                victim_seat=config.victim_side,
            )
    return found


class RetrainResult(BaseModel):
    """The result of a retraining.

    Attributes:
        directory: where everything is.
        victim: as it was.
        hardened: as it is now.
        opponents: by label: each adversary's method, and ``baseline``.
        shares: of play, by label.
        before, after: scores of each opponent on its own against the victim as it was and as it is now, by
            label. As everywhere ``wins`` are the adversary's: the victim's are its ``losses``.
    """

    model_config = EXACT

    directory: Path
    status: Literal["finished", "interrupted", "failed"]
    env: str
    steps: int
    wall_seconds: float
    victim: PolicyId
    hardened: PolicyId
    opponents: dict[str, PolicyId]
    shares: dict[str, float]
    before: dict[str, EvaluationResult] = {}
    after: dict[str, EvaluationResult] = {}

    def __fspath__(self) -> str:
        """The directory: a result may stand wherever the hardened victim's name does."""
        return str(self.directory)
