"""What a retraining leaves in ``result.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel

from apil_core.evaluation.results import EvaluationResult, PolicyId


class RetrainResult(BaseModel):
    """How a retraining ended.

    Attributes:
        directory: where everything is.
        victim: as it was.
        hardened: as it is now.
        opponents: by label: each adversary's method, and ``baseline``.
        shares: of play, by label.
        before, after: scores of each opponent on its own against the victim as it was and as it is now, by
            label. As everywhere ``wins`` are the adversary's: the victim's are its ``losses``.
    """

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
