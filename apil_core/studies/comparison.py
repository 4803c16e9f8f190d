"""Compare the scores of several runs, and mark differences within noise."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel

from apil_core.common.statistics import Difference
from apil_core.config.game import stored_game, stored_physics
from apil_core.evaluation.results import EvaluationResult, Rate, gap, in_words, with_observers_played
from apil_core.studies.curves.curves import final_score
from apil_core.studies.curves.groups import seed_groups
from apil_core.training.storage.run_dir import RunDir


class Row(BaseModel):
    """One run; scores are ``None`` without a final evaluation, differences in the first row too."""

    run: str
    method: str
    env: str
    physics: str | None = None
    victim: str
    seed: int
    steps: int
    status: str
    episodes: int = 0
    action_modes: str = ""
    observers: str = ""
    win: Rate | None = None
    win_or_tie: Rate | None = None
    win_difference: Difference | None = None
    win_or_tie_difference: Difference | None = None


class Spread(BaseModel):
    """Runs that differ in the seed only: mean and standard deviation of their shares."""

    method: str
    env: str
    victim: str
    steps: int
    seeds: list[int]
    win_mean: float
    win_sd: float
    win_or_tie_mean: float
    win_or_tie_sd: float


class Comparison(BaseModel):
    """Output of ``apil runs compare --json``."""

    rows: list[Row]
    spreads: list[Spread]
    warnings: list[str]


def compare(runs: Sequence[RunDir]) -> Comparison:
    """Compare runs with the first one.

    Raises:
        RunDirError: one of them is no run directory, or its result is damaged.
    """
    scores = [final_score(run) for run in runs]
    rows = [_row(run, score) for run, score in zip(runs, scores, strict=True)]
    first = scores[0]
    for row, score in list(zip(rows, scores, strict=True))[1:]:
        if first is not None and score is not None:
            row.win_difference = gap(score, first, ties=False)
            row.win_or_tie_difference = gap(score, first, ties=True)
    warnings = [*_warnings(rows), *_other_options(runs)]
    return Comparison(rows=rows, spreads=_spreads(runs, rows), warnings=warnings)


def _row(run: RunDir, score: EvaluationResult | None) -> Row:
    config, summary = run.config(), run.summary()
    facts: dict[str, Any] = {}
    if score is not None:
        facts = {
            "episodes": score.episodes,
            "action_modes": f"{score.adversary_actions}/{score.victim_actions}",
            "observers": ", ".join(in_words(with_observers_played(score, config).observers or {})),
            "win": score.win_rate,
            "win_or_tie": score.win_or_tie_rate,
        }
    return Row(
        run=str(run.path),
        method=config.method,
        env=config.env,
        physics=stored_physics(config),
        victim=run.victim(),
        seed=config.seed,
        steps=summary["steps"],
        status=summary["status"],
        **facts,
    )


def _spreads(runs: Sequence[RunDir], rows: Sequence[Row]) -> list[Spread]:
    groups: dict[tuple[int, str, str, str, int, str], list[tuple[int, float, float]]] = {}
    for number, places in enumerate(seed_groups(runs)):
        for row in (rows[place] for place in places):
            if row.win is not None and row.win_or_tie is not None:
                key = (number, row.method, row.env, row.victim, row.steps, row.action_modes)
                groups.setdefault(key, []).append((row.seed, row.win.value, row.win_or_tie.value))
    spreads = []
    for (_, method, env, victim, steps, _), members in groups.items():
        seeds, wins, wins_or_ties = (list(column) for column in zip(*members, strict=True))
        if len(set(seeds)) > 1:
            spreads.append(
                Spread(
                    method=method,
                    env=env,
                    victim=victim,
                    steps=steps,
                    seeds=seeds,
                    win_mean=statistics.mean(wins),
                    win_sd=statistics.stdev(wins),
                    win_or_tie_mean=statistics.mean(wins_or_ties),
                    win_or_tie_sd=statistics.stdev(wins_or_ties),
                )
            )
    return spreads


def _warnings(rows: Sequence[Row]) -> list[str]:
    scored = [row for row in rows if row.win is not None]
    warnings = [f"{row.run} has no final evaluation ({row.status})" for row in rows if row.win is None]
    for name in ("env", "victim", "action_modes", "observers", "steps"):
        values = sorted({str(getattr(row, name)) or "none" for row in scored})
        if len(values) > 1:
            warnings.append(f"runs differ in {name.replace('_', ' ')}: {', '.join(values)}")
    return warnings


def _other_options(runs: Sequence[RunDir]) -> list[str]:
    """One line with the game options in which runs of one game differ."""
    configs = [run.config() for run in runs]
    if len({config.env for config in configs}) > 1:
        return []  # reported already, and options of different games are not comparable
    games = [stored_game(config) for config in configs]
    different = []
    for key in dict.fromkeys(key for game in games for key in game):
        values = list(dict.fromkeys(str(game.get(key)) for game in games))
        if len(values) > 1:
            different.append(f"{key} ({', '.join(values)})")
    return [f"runs differ in the game's options: {', '.join(different)}"] if different else []
