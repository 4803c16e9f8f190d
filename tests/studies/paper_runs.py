"""Run directories whose metrics are written by hand, so that every number in a curve is known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from helpers.small_runs import small_config

from apil_core.plugins.registry import default_plugins
from apil_core.training.storage.recorders import JsonlRecorder
from apil_core.training.storage.run_dir import RunDir

VICTIM = "scripted:toy-pursuit/evader/v1"


def row(steps: int, games: int, wins: int, ties: int = 0, **more: float) -> dict[str, float]:
    """The metrics of an iteration; its games are the window's."""
    window = {"window_games": games, "window_wins": wins, "window_ties": ties}
    return {"iteration": steps // 1000, "steps": steps, "games": games, **window, **more}


def write_run(path: Path, rows: list[dict[str, float]], method: str = "adrl", **changes: Any) -> RunDir:
    """A run of that method on the toy game."""
    config = small_config(method, **{"victim": VICTIM, **changes})
    run = RunDir.create(config, path, (), default_plugins())
    recorder = JsonlRecorder(run.path)
    for metrics in rows:
        recorder.record(metrics)
    recorder.close()
    return run


def score(steps: int, wins: int, ties: int, losses: int, victim: str = VICTIM) -> dict[str, Any]:
    """What ``result.json`` holds after a run of so many steps with that score."""
    from apil_core.evaluation.results import EvaluationResult, wilson

    games = wins + ties + losses
    counts = {"win": wins, "tie": ties, "loss": losses, "win_or_tie": wins + ties}
    result = EvaluationResult(
        env="toy-pursuit",
        adversary={"name": "run:somewhere", "sha256": ""},
        victim={"name": victim, "sha256": ""},
        adversary_side="pursuer",
        victim_side="evader",
        adversary_actions="sample",
        victim_actions="sample",
        seed=0,
        num_envs=1,
        trained_steps=steps,
        game_options={},
        versions={},
        episodes=games,
        wins=wins,
        ties=ties,
        losses=losses,
        causes={},
        mean_length=1.0,
        wall_seconds=0.0,
        **{f"{name}_rate": wilson(count, games) for name, count in counts.items()},
    )
    return {"status": "finished", "steps": steps, "evaluation": json.loads(result.model_dump_json())}
