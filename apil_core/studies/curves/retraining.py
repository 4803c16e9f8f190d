"""A victim's results against each opponent during retraining, as lines and as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from apil_core.api.profiles import FAITHFUL
from apil_core.common.errors import RunDirError
from apil_core.common.extras import need
from apil_core.config.game import PHYSICS
from apil_core.evaluation.results import EvaluationResult, wilson
from apil_core.runs.retraining.config import MIXED, RetrainConfig
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.studies.curves.captions import Wording
from apil_core.studies.curves.curves import LEAST_GAMES, Curve, ScorePoint, shares
from apil_core.studies.curves.groups import CurveGroup
from apil_core.training.episode_stats import WINDOW
from apil_core.training.storage.recorders import read_metrics

Row = dict[str, float]


def read_opponents(directory: RetrainDir) -> list[CurveGroup]:
    """Read one curve per opponent; shares and scores are the victim's.

    Where opponents take turns from step to step, one more curve has all games.

    Raises:
        RunDirError: no retraining there, or its metrics are missing, damaged or too few for a curve.
    """
    config, rows = directory.config(), read_metrics(directory.metrics_path)
    games = max((int(row.get("window_games", 0)) for row in rows[-1:]), default=0)
    if games < LEAST_GAMES:
        raise RunDirError(
            f"{directory.metrics_path}: {games} training games have ended, a curve needs {LEAST_GAMES}"
        )
    mixed = (MIXED,) if any(f"opponent/{MIXED}/games" in row for row in rows) else ()
    results = [value for value in directory.results().values() if value.get("status") != "failed"]
    physics = config.game.get(PHYSICS)
    return [
        CurveGroup(label=label, curves=[curve], lines=curve.lines)
        for label in (*mixed, *config.labels)
        for curve in [
            Curve(
                run=str(directory.path),
                method=label,
                env=config.env,
                victim=config.victim,
                physics=physics if isinstance(physics, str) else None,
                seed=config.seed,
                steps=int(rows[-1]["steps"]),
                lines=shares(rows, f"opponent/{label}/"),
                scores=_scores(label, rows, results),
            )
        ]
    ]


def draw_opponents(directory: RetrainDir, path: Path) -> list[CurveGroup]:
    """Draw :func:`read_opponents`; a file of that name is replaced.

    Raises:
        ApilError: there is no curve yet, or the file cannot be written, or not in that format.
    """
    need("matplotlib")
    from apil_core.studies.curves.picture import draw_curves

    groups = read_opponents(directory)
    draw_curves(groups, path, _wording(directory.config(), groups))
    return groups


def _scores(label: str, rows: Sequence[Row], results: Sequence[Mapping[str, Any]]) -> list[ScorePoint]:
    """Scores before, during and after the retraining; of several at the same steps the last."""
    points = []
    for result in results:
        for key, steps in (("before", 0), ("after", int(result["steps"]))):
            if label in result.get(key, {}):
                score = EvaluationResult.model_validate(result[key][label])
                points.append(_point(steps, score.episodes, score.losses, score.ties))
    for row in rows:
        keys = [f"evaluation/{label}/{name}" for name in ("games", "wins", "ties")]
        if all(key in row for key in keys):
            points.append(_point(int(row["steps"]), *(int(row[key]) for key in keys)))
    found = {point.steps: point for point in points if point.steps <= rows[-1]["steps"]}
    return [found[steps] for steps in sorted(found)]


def _point(steps: int, games: int, wins: int, ties: int) -> ScorePoint:
    return ScorePoint(
        steps=steps, episodes=games, win=wilson(wins, games), win_or_tie=wilson(wins + ties, games)
    )


def _wording(config: RetrainConfig, groups: Sequence[CurveGroup]) -> Wording:
    physics = config.game.get(PHYSICS)
    custom = f", {physics} physics" if isinstance(physics, str) and physics != FAITHFUL else ""
    share = f"{100 * config.adversary_share:.3g} % of {'games' if config.mix == 'per_episode' else 'steps'}"
    turns = "against each opponent" if config.mix == "per_episode" else "with opponents taking turns"
    steps = groups[0].curves[0].steps
    lines = [
        f"{steps:,} steps, seed {config.seed}, {share} against the adversaries. "
        f"Lines: the last {WINDOW} training games {turns} (fewer at first).",
        "Bands: 95 % intervals of the shares.",
    ]
    games = sorted({point.episodes for group in groups for point in group.curves[0].scores})
    if games:
        number = " or ".join(f"{count:,}" for count in games)
        lines.append(f"Points: scores of {number} games against one opponent, with 95 % intervals.")
    return Wording(f"{config.victim} retrained in {config.env}{custom}", "\n".join(lines), "the victim")
