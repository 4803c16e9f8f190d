"""Learning curves: training games, returns and scores of a run over environment steps."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.statistics import wilson_interval
from apil_core.config.game import stored_physics
from apil_core.evaluation.results import EvaluationResult, Rate
from apil_core.training.episode_stats import WINDOW
from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir

LEAST_GAMES = 20
"""Ended games below which a share of them is not worth drawing."""

WIN, WIN_OR_TIE, RETURN, IMITATOR = "win", "win_or_tie", "return", "imitator"
"""Names of the lines that every run has, and of the one that runs with an imitator have."""

_NEEDED = ("steps", "games", "window_games", "window_wins", "window_ties")


class Line(BaseModel):
    """Values over environment steps, with an optional band.

    Attributes:
        steps: (n,), rising.
        value: (n,); shares of games are fractions.
        low, high: (n,), or empty.
    """

    steps: list[int]
    value: list[float]
    low: list[float] = []
    high: list[float] = []


class ScorePoint(BaseModel):
    """An evaluation after a number of training steps."""

    steps: int
    episodes: int
    win: Rate
    win_or_tie: Rate


class Curve(BaseModel):
    """One run.

    Attributes:
        run: its directory.
        victim: the policy it was trained against.
        physics: profile it was trained in, or ``"custom"``; ``None`` for a game without profiles.
        steps: of training so far.
        lines: by name. :data:`WIN` and :data:`WIN_OR_TIE`: shares of the last 1000 training games with
            Wilson 95 % intervals; :data:`RETURN`: the adversary's mean return of about as many;
            :data:`IMITATOR`: its squared error as a multiple of the best constant's; single metrics.
        scores: evaluations, periodic and final.
    """

    run: str
    method: str
    env: str
    victim: str
    physics: str | None = None
    seed: int
    steps: int
    lines: dict[str, Line]
    scores: list[ScorePoint]


def read_curve(run: RunDir, metrics: Sequence[str] = ()) -> Curve:
    """Read the curve of one run, finished or not.

    Args:
        run: its directory.
        metrics: further metrics to take in, by their names in ``metrics.jsonl``.

    Raises:
        RunDirError: no run there, or its metrics are missing, damaged or too few for a curve.
        ConfigError: a metric that the run does not have.
    """
    config = run.config()
    rows = read_metrics(run.metrics_path)
    _check(run.metrics_path, rows)
    lines = {**shares(rows, "window_"), RETURN: _returns(rows), IMITATOR: _imitator(rows)}
    lines |= {name: _metric(run, rows, name) for name in metrics}
    return Curve(
        run=str(run.path),
        method=config.method,
        env=config.env,
        victim=run.victim(),
        physics=stored_physics(config),
        seed=config.seed,
        steps=int(rows[-1]["steps"]),
        lines={name: line for name, line in lines.items() if line.steps},
        scores=_scores(rows, final_scores(run)),
    )


def _check(path: Path, rows: Sequence[dict[str, float]]) -> None:
    for number, row in enumerate(rows, 1):
        missing = [key for key in _NEEDED if not np.isfinite(row.get(key, np.nan))]
        if missing:
            raise RunDirError(f"{path}:{number}: no number for {', '.join(missing)}")
    games = int(rows[-1]["window_games"]) if rows else 0
    if games < LEAST_GAMES:
        raise RunDirError(f"{path}: {games} training games have ended, a curve needs {LEAST_GAMES}")


def shares(rows: Sequence[dict[str, float]], prefix: str) -> dict[str, Line]:
    """Shares won, and won or tied, of a running window of games, with Wilson 95 % intervals.

    Args:
        rows: of metrics.
        prefix: of the window's ``games``, ``wins`` and ``ties`` in them.
    """
    kept = [row for row in rows if row.get(f"{prefix}games", 0) >= LEAST_GAMES]
    steps = [int(row["steps"]) for row in kept]
    games, wins, ties = (
        np.array([row[f"{prefix}{name}"] for row in kept]) for name in ("games", "wins", "ties")
    )
    lines = {}
    for name, count in ((WIN, wins), (WIN_OR_TIE, wins + ties)):
        low, high = wilson_interval(count, games)
        value = (count / games).tolist()
        lines[name] = Line(steps=steps, value=value, low=low.tolist(), high=high.tolist())
    return lines


def _returns(rows: Sequence[dict[str, float]]) -> Line:
    """Mean return of the adversary over at least the last 1000 games, fewer at the beginning.

    Per iteration there is a mean over the games that ended in it: they are weighted by their number.
    """
    kept = [row for row in rows if row["games"] > 0 and np.isfinite(row.get("return/adversary", np.nan))]
    games = np.array([row["games"] for row in kept])
    sums = np.array([row["return/adversary"] for row in kept]) * games
    total, summed = (np.concatenate([[0.0], np.cumsum(values)]) for values in (games, sums))
    # the last iteration before which so many games fit between it and the present
    start = np.maximum(np.searchsorted(total, total[1:] - WINDOW, side="right") - 1, 0)
    means = (summed[1:] - summed[start]) / (total[1:] - total[start])
    enough = total[1:] >= LEAST_GAMES
    steps = np.array([int(row["steps"]) for row in kept])
    return Line(steps=steps[enough].tolist(), value=means[enough].tolist())


def _imitator(rows: Sequence[dict[str, float]]) -> Line:
    """Imitator error relative to the best constant's: below 1 it has learnt something."""
    pairs = [(row, row.get("apil/constant_mse", 0.0)) for row in rows]
    ratios = [(int(row["steps"]), row.get("apil/mse", np.nan) / best) for row, best in pairs if best > 0]
    finite = [(steps, value) for steps, value in ratios if np.isfinite(value)]
    return Line(steps=[steps for steps, _ in finite], value=[value for _, value in finite])


def _metric(run: RunDir, rows: Sequence[dict[str, float]], name: str) -> Line:
    known = sorted({key for row in rows for key in row})
    if name not in known:
        close = get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(known)}"
        raise ConfigError(f"{run.path} has no metric {name!r} ({hint})")
    finite = [row for row in rows if np.isfinite(row.get(name, np.nan))]
    if not finite:
        raise ConfigError(f"{run.path}: there is no number yet for metric {name!r}")
    return Line(steps=[int(row["steps"]) for row in finite], value=[row[name] for row in finite])


def _scores(rows: Sequence[dict[str, float]], final: Sequence[EvaluationResult]) -> list[ScorePoint]:
    points = {int(row["steps"]): _periodic(row) for row in rows if "evaluation/win" in row}
    for score in final:
        steps = score.trained_steps or 0
        if steps <= rows[-1]["steps"]:  # a later one belongs to an abandoned continuation
            rates = {"win": score.win_rate, "win_or_tie": score.win_or_tie_rate}
            points[steps] = ScorePoint(steps=steps, episodes=score.episodes, **rates)
    return [points[steps] for steps in sorted(points)]


def _periodic(row: dict[str, float]) -> ScorePoint:
    def rate(name: str) -> Rate:
        value, low, high = (row[f"evaluation/{name}{end}"] for end in ("", "_low", "_high"))
        return Rate(value=value, low=low, high=high)

    games = int(row["evaluation/episodes"])
    return ScorePoint(steps=int(row["steps"]), episodes=games, win=rate("win"), win_or_tie=rate("win_or_tie"))


def final_score(run: RunDir) -> EvaluationResult | None:
    """The run's final score; ``None`` if it has not ended, or ended without one.

    Raises:
        RunDirError: the stored file is no score.
    """
    return _score(run.result_path, run.summary()["evaluation"])


def final_scores(run: RunDir) -> list[EvaluationResult]:
    """Like :func:`final_score`, preceded by those of earlier ends if the run was extended.

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
