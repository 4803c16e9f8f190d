"""The scores a run directory holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apil_core.common.errors import RunDirError
from apil_core.evaluation.results import EvaluationResult
from apil_core.training.storage.run_dir import RunDir


def final_score(run: RunDir) -> EvaluationResult | None:
    """The score the run ended with, or ``None`` if it has not ended, or ended without one.

    Raises:
        RunDirError: what is stored is no score.
    """
    return _score(run.result_path, run.summary()["evaluation"])


def final_scores(run: RunDir) -> list[EvaluationResult]:
    """As :func:`final_score`, with those of earlier ends first if the run was extended.

    Raises:
        RunDirError: a file with a result is damaged.
    """
    results = run.results()
    scores = (_score(path, result.get("evaluation")) for path, result in results.items())
    return sorted((s for s in scores if s is not None), key=lambda score: score.trained_steps or 0)


def _score(path: Path, evaluation: Any) -> EvaluationResult | None:
    try:
        return EvaluationResult.model_validate(evaluation) if evaluation else None
    except ValueError as error:
        raise RunDirError(f"{path} is damaged: {' '.join(str(error).split())}") from error
