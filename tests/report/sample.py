"""A benchmark whose every number is written by hand: no game is played for it.

Two games, three methods, two seeds, two values of ã, 1 M steps; one cell failed and one is still at work.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from apil_core.api.config import RunConfig
from apil_core.evaluation.crossplay.document import CrossPlay, Player
from apil_core.evaluation.results import EvaluationResult, wilson
from apil_core.plugins.registry import default_plugins
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.studies.activations.models import ActivationMap, LogLikelihood
from apil_core.studies.bench.cells import Cell, resolve_matrix
from apil_core.studies.bench.folder import BenchDir, write_score
from apil_core.studies.bench.matrix import Matrix
from apil_core.studies.report import cells
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.paper_claims import ORDER
from apil_core.studies.report.report_data import gather
from apil_core.studies.report.table_models import Side, Table
from apil_core.training.storage.recorders import JsonlRecorder
from apil_core.training.storage.run_dir import RunDir

KICK, SUMO = "kick-and-defend", "sumo-humans"
VICTIMS = {KICK: "zoo:kick-and-defend/kicker/v1", SUMO: "zoo:sumo-humans/fighter/v3"}
BASELINES = {KICK: "zoo:kick-and-defend/defender/v1", SUMO: "zoo:sumo-humans/fighter/v1"}
STEPS = 1_000_000
FAILED = "sumo-humans/apl/s1"
WORKING = "sumo-humans/adrl/s1"

WINS_TIES: Mapping[tuple[str, str], tuple[int, int]] = {
    (KICK, "baseline"): (280, 10),
    (KICK, "adrl"): (480, 10),
    (KICK, "apl"): (500, 10),
    (KICK, "e_apil"): (700, 20),
    (SUMO, "baseline"): (70, 30),
    (SUMO, "adrl"): (10, 490),
    (SUMO, "apl"): (20, 480),
    (SUMO, "e_apil"): (15, 485),
}
"""Of 1000 games of seed 0; seed 1 wins 20 more. Blinded ones win half; without ã a tenth is lost."""

Counts = tuple[int, ...]
"""Wins of 1000 games, one per seed."""

ENVIRONMENT = {"host": "a machine", "git": "abc", "versions": {"torch": "2"}}

TIE = {KICK: "keeper-left-goal", SUMO: "fighter_1-left-ring-untouched"}


def matrix() -> Matrix:
    """What was asked for."""
    return Matrix.model_validate(
        {
            "title": "A sample",
            "methods": ["adrl", "apl", "e_apil"],
            "games": [KICK, SUMO],
            "seeds": [0, 1],
            "steps": STEPS,
            "victims": VICTIMS,
            "config": {"game": {"physics": "fast"}, "recorders": ["jsonl"]},
            "axes": {"options.apil.prediction": ["imitator", "none"]},
            "scores": {"plain": {}, "blinded": {"blind": "zeros"}},
            "retraining": {"steps": 500_000},
            "crossplay": {},
        }
    )


def result(env: str, wins: int, ties: int, games: int = 1000, **changes: Any) -> EvaluationResult:
    """A score with these counts of the adversary."""
    losses = games - wins - ties
    counts = {"win": wins, "tie": ties, "loss": losses, "win_or_tie": wins + ties}
    causes = {"both-down": wins, TIE.get(env, "time-up"): ties, "goal": losses}
    fields: dict[str, Any] = {
        "env": env,
        "adversary": {"name": "run:somewhere", "sha256": "a"},
        "victim": {"name": VICTIMS.get(env, "scripted:toy-pursuit/evader/v1"), "sha256": "b"},
        "adversary_side": "keeper",
        "victim_side": "kicker",
        "adversary_actions": "sample",
        "victim_actions": "sample",
        "seed": 0,
        "num_envs": 128,
        "trained_steps": STEPS,
        "game_options": {},
        "game_settings": {"physics": "fast"},
        "versions": {},
        "episodes": games,
        "wins": wins,
        "ties": ties,
        "losses": losses,
        "causes": {name: count for name, count in causes.items() if count},
        "mean_length": 100.0,
        "wall_seconds": 1.0,
        **{f"{name}_rate": wilson(count, games) for name, count in counts.items()},
    }
    return EvaluationResult(**{**fields, **changes})


def rows(cell: Cell, wins: int, ties: int) -> list[dict[str, float]]:
    """Metrics of ten rows, whose shares of wins and ties rise to the given ones."""
    steps = [STEPS * (i + 1) // 10 for i in range(4 if cell.name == WORKING else 10)]
    own = []
    for i, step in enumerate(steps):
        row: dict[str, float] = {
            "iteration": i + 1,
            "steps": step,
            "games": 500,
            "window_games": 1000,
            "window_wins": wins * (i + 1) // 10,
            "window_ties": ties * (i + 1) // 10,
            "return/adversary": i - 5.0,
            "return/victim": 5.0 - i,
            "reward/uneven_share": 0.001,
            "ppo/kl": 0.01,
            "wall_seconds": 60.0 * (i + 1),
        }
        if cell.method == "e_apil" and cell.axes.get("options.apil.prediction") == "imitator":
            row |= {"apil/mse": 1.2, "apil/constant_mse": 1.0}
        own.append(row)
    return own


def score_counts(cell: Cell) -> tuple[int, int]:
    """Wins and ties of a cell."""
    wins, ties = WINS_TIES[cell.game, cell.method]
    lost = wins // 10 if cell.axes.get("options.apil.prediction") == "none" else 0
    return wins + 20 * cell.seed - lost, ties


def hand_table(
    number: Literal[1, 2, 3, 4],
    games: Mapping[str, Mapping[str, Counts]],
    side: Side = "adversary",
    columns: Sequence[str] = ("baseline", *ORDER),
) -> Table:
    """A table of these wins; no ties, nothing published."""
    rows = []
    for game, columns_of in games.items():
        row = []
        for column in columns:
            trained = None if column == "baseline" else STEPS
            scores = [
                cells.seed_score(result(game, wins, 0, trained_steps=trained), f"{column}{seed}", seed)
                for seed, wins in enumerate(columns_of.get(column, ()))
            ]
            row.append(cells.cell(game, column, scores, None))
        rows.append(row)
    blind = "zeros" if number == 2 else None
    named = {"id": f"t{number}", "name": "", "title": "", "setting": "s1"}
    return Table(number=number, side=side, columns=list(columns), blind=blind, rows=rows, **named)


def sample_bench(path: Path) -> BenchDir:
    """Write the benchmark."""
    bench, benchmark = BenchDir(path), resolve_matrix(matrix())
    bench.write_matrix(benchmark.matrix)
    for cell in benchmark.cells:
        _cell(bench, cell)
    for game in VICTIMS:
        wins, ties = WINS_TIES[game, "baseline"]
        who = {"adversary": {"name": BASELINES[game], "sha256": "c"}, "trained_steps": None}
        write_score(bench.adversary_dir(game), "plain", result(game, wins, ties, **who))
        write_score(bench.adversary_dir(game), "blinded", result(game, wins // 2, ties, blind="zeros", **who))
    _retrained(bench)
    _crossplay(bench)
    _activations(bench)
    _snapshot(bench)
    return bench


def sample_data(path: Path) -> ReportData:
    """What the report says about it."""
    return gather([sample_bench(path).path])


def write_run(run: RunDir, config: RunConfig, metrics: list[dict[str, float]]) -> None:
    """Write its configuration (as JSON, which is YAML and quick to write), a note of where, and metrics.

    Beside it the copy that ``write_copy`` makes, which is quick to read.
    """
    run.path.mkdir(parents=True)
    text = config.model_dump_json()
    run.config_path.write_text(text)
    copy = {"sha256": hashlib.sha256(text.encode()).hexdigest(), "data": json.loads(text)}
    run.write_json(run.config_path.with_suffix(".json"), copy)
    run.write_json(run.environment_path, [ENVIRONMENT])
    recorder = JsonlRecorder(run.path)
    for row in metrics:
        recorder.record(row)
    recorder.close()


def _cell(bench: BenchDir, cell: Cell) -> None:
    if cell.name == FAILED:
        bench.note_failure(f"cells/{cell.name}", "the disk is full")
        return
    wins, ties = score_counts(cell)
    run = RunDir(bench.cell(cell.name).path)
    write_run(run, cell.config, rows(cell, wins, ties))
    if cell.name == WORKING:
        return
    run.write_json(run.result_path, {"status": "finished", "steps": STEPS, "evaluation": None})
    who = {"adversary": {"name": f"run:{run.path}", "sha256": "d"}}
    write_score(run.path, "plain", result(cell.game, wins, ties, **who))
    write_score(run.path, "blinded", result(cell.game, wins // 2, ties, blind="zeros", **who))


def _retrained(bench: BenchDir) -> None:
    path = bench.retrained_dir(f"{KICK}/e_apil/s0-apil.prediction=imitator")
    config = RetrainConfig(
        adversaries=("run:somewhere",),
        labels=("e_apil", "baseline"),
        env=KICK,
        victim=VICTIMS[KICK],
        victim_side=0,
        steps=500_000,
        recorders=("jsonl",),
    )
    folder = RetrainDir.create(config, path, ["apil", "retrain"], default_plugins())
    recorder = JsonlRecorder(path)
    for i in range(5):
        counts = {"games": 500, "wins": 100 + 50 * i, "ties": 5}
        opponents = {f"opponent/{label}/{k}": v for label in config.labels for k, v in counts.items()}
        row = {"iteration": i + 1, "steps": 100_000 * (i + 1), "games": 50, "window_games": 1000}
        recorder.record({**row, **opponents})
    recorder.close()
    folder.write_json(folder.result_path, {"status": "finished", "steps": 500_000})


def _crossplay(bench: BenchDir) -> None:
    """The adversary's wins; the victim loses those and ties none."""
    wins = {
        ("baseline", "original"): 280,
        ("baseline", "vs adrl"): 300,
        ("baseline", "vs e_apil"): 250,
        ("adrl", "original"): 490,
        ("adrl", "vs adrl"): 200,
        ("adrl", "vs e_apil"): 450,
        ("e_apil", "original"): 700,
        ("e_apil", "vs adrl"): 690,
        ("e_apil", "vs e_apil"): 400,
    }
    adversaries, victims = ("baseline", "adrl", "e_apil"), ("original", "vs adrl", "vs e_apil")
    trained = {"baseline": None, "adrl": STEPS, "e_apil": STEPS}
    retrained = bench.retrained_dir(f"{KICK}/e_apil/s0-apil.prediction=imitator")
    names = {"original": VICTIMS[KICK]}
    document = CrossPlay(
        env=KICK,
        adversaries=[
            Player(name=label, sha256="", label=label, method=None if label == "baseline" else label, seed=0)
            for label in adversaries
        ],
        victims=[
            Player(name=names.get(v, f"retrained:{retrained}"), sha256="", label=v, seed=0) for v in victims
        ],
        scores=[
            [result(KICK, wins[a, v], 0, trained_steps=trained[a]) for v in victims] for a in adversaries
        ],
        created="2026-01-01T00:00:00+0000",
    )
    bench.crossplay_path(KICK).parent.mkdir()
    document.write(bench.crossplay_path(KICK))


def _activations(bench: BenchDir) -> None:
    labels = ["baseline", "adrl", "e_apil"]
    document = ActivationMap(
        env=KICK,
        victim=VICTIMS[KICK],
        victim_sha256="b",
        layer="LSTM state",
        units=128,
        physics="fast",
        opponents=labels,
        players=[Player(name=label, sha256="", label=label) for label in labels],
        points=[[(i + 0.1 * k, (-1.0) ** k) for k in range(30)] for i, _ in enumerate(labels)],
        log_likelihood=[
            LogLikelihood(mean=m, low=m - 1, high=m + 1, n=40, explained=0.75) for m in (-10.0, -20.0, -30.0)
        ],
        fitted=-9.0,
        games_per_opponent=40,
        samples_per_game=50,
        components=3,
        bic={3: 1.0},
        variance=0.95,
        dimensions=12,
        explained=0.96,
        perplexity=30.0,
        seed=0,
        num_envs=40,
        versions={},
        created="2026-01-01T00:00:00+0000",
    )
    bench.activations_path(KICK).parent.mkdir()
    document.write(bench.activations_path(KICK))


def _snapshot(bench: BenchDir) -> None:
    from PIL import Image

    path = bench.snapshot_path(f"{KICK}/e_apil/s0-apil.prediction=imitator")
    path.parent.mkdir(parents=True)
    Image.new("RGB", (60, 20), "gray").save(path)
