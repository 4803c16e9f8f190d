"""Brings finished runs home, plays scores, ships adversaries, and makes the tables of ``docs/results.md``.

    python docs/make_campaign.py home DIR...      # finished runs in DIR (a benchmark's or a run's directory)
    python docs/make_campaign.py score [WORD...]  # missing scores; only of cells whose path has a WORD
    python docs/make_campaign.py ship RUN         # its adversary becomes embedded:GAME/adversary/v1
    python docs/make_campaign.py                  # tables and curves only, as after each of these

``home`` keeps at most a megabyte of a run in ``docs/results/campaign/cells/GAME/METHOD/sSEED``: its adversary
in ONNX, settings, result, scores and every twentieth row of its metrics. A run takes the place of a shorter
one of the same name. ``score`` plays 1000 games each with the adversary in ONNX, on one thread. ``ship``
needs the run at home, and notes its scores in both physics.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apil_core import EvaluationResult, RunConfig, evaluate
from apil_core.evaluation.results import Rate
from apil_core.plugins.default_victim import default_baseline
from apil_core.plugins.registry import default_plugins, plugins_with
from apil_core.studies.bench.folder import read_score, score_path, write_score
from apil_core.studies.curves.groups import read_groups
from apil_core.studies.curves.picture import draw_curves
from apil_core.studies.report.published import published
from apil_core.training.export.embedded import folder
from apil_core.training.export.export import export, write
from apil_core.training.export.run_policy import RunCheckpoint
from apil_core.training.storage.run_dir import RunDir

HERE = Path(__file__).parent
PAGE = HERE / "results.md"
HOME = HERE / "results" / "campaign"  # laid out as a benchmark, so that `apil bench report` reads it
LONG = HERE / "results" / "long"
BEGIN, END = "<!-- made by make_campaign.py -->", "<!-- end of what make_campaign.py made -->"

SCORES: dict[str, dict[str, Any]] = {
    "plain": {"physics": "fast"},
    "faithful": {"physics": "faithful"},
    "unseen": {"physics": "fast", "blind_victim": "zeros"},
    "blinded": {"physics": "fast", "blind": "zeros"},
    "mode": {"physics": "fast", "adversary_actions": "mode"},
    "faithful-mode": {"physics": "faithful", "adversary_actions": "mode"},
}
"""Options of each score, most wanted first."""

CURVES = ("win", "win_or_tie", "imitator")
"""Panels of the picture."""

THIN = 20
"""Rows of metrics for each one that is kept, besides those with evaluations."""


@dataclass(frozen=True)
class Cell:
    """A run at home, or the game's own opponent of its victim (``steps`` 0)."""

    path: Path
    config: RunConfig
    steps: int

    @property
    def label(self) -> str:
        """Method, and what its settings are."""
        if not self.steps:
            return "*own opponent*"
        named = {"paper": LONG in self.path.parents, "sumo-ants": self.config.game.get("untouched_reward")}
        return ", preset ".join(f"`{name}`" for name in (self.config.method, *filter(named.get, named)))

    @property
    def adversary(self) -> str:
        if self.steps:
            return f"onnx:{self.path / 'adversary.onnx'}"
        plugins = default_plugins()
        return default_baseline(plugins.game(self.config.env), plugins)

    def score(self, name: str) -> EvaluationResult | None:
        score: EvaluationResult | None = read_score(self.path, name)
        return score


def cells() -> list[Cell]:
    """Every run at home in the paper's order of games and methods, each game's own opponent first."""
    found, paper = [], published()
    for top in (HOME / "cells", LONG):
        for file in top.glob("*/*/s*/result.json"):
            run = RunDir(file.parent)
            found.append(Cell(run.path, run.config(), json.loads(file.read_text())["steps"]))
    own = {cell.config.env: Cell(HOME / "baseline" / cell.config.env, cell.config, 0) for cell in found}

    def order(cell: Cell) -> tuple[int, bool, int, int, int]:
        config = cell.config
        method = paper.columns.index(config.method)
        return paper.games.index(config.env), cell.steps > 0, method, -cell.steps, config.seed

    return sorted([*found, *own.values()], key=order)


def home(top: Path) -> None:
    """Copy every finished run below ``top``."""
    for config in sorted(((top / "cells") if (top / "cells").is_dir() else top).rglob("config.yaml")):
        run = RunDir(config.parent)
        if run.summary()["status"] == "finished":
            bring(run, HOME / "cells")
    for file in top.glob("baseline/*/scores/*.json"):
        if not (target := HOME / file.relative_to(top)).is_file():  # the page's text cites what is there
            copy(file, target)


def bring(run: RunDir, into: Path) -> None:
    """Copy one run, unless another one that is no shorter has its place."""
    config, result = run.config(), run.path / "result.json"
    target = into / config.env / config.method / f"s{config.seed}"
    there = target / result.name
    if there.is_file() and there.read_bytes() != result.read_bytes():
        if json.loads(there.read_text())["steps"] >= json.loads(result.read_text())["steps"]:
            return print(f"{run.path}: another run, no shorter, is in {target}")
        shutil.rmtree(target)  # scores are of the adversary, so they go with it
    if not there.is_file():
        target.mkdir(parents=True, exist_ok=True)
        export(run.path, "onnx", target / "adversary.onnx", force=True)
        rows = run.metrics_path.read_text().splitlines(keepends=True)
        kept = [
            row for i, row in enumerate(rows, 1) if i % THIN == 1 or i == len(rows) or '"evaluation/' in row
        ]
        (target / "metrics.jsonl").write_text("".join(kept))
        for name in ("config.yaml", "environment.json", "result.json"):
            copy(run.path / name, target / name)
    for file in (run.path / "scores").glob("*.json"):
        if file.stem in SCORES:
            copy(file, target / "scores" / file.name)
    score = json.loads(result.read_text())["evaluation"]
    if score and score["episodes"] == 1000 and not score_path(target, "plain").is_file():
        write_score(target, "plain", EvaluationResult.model_validate(score))
    print(f"{run.path} is in {target}")


def copy(file: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, target)


def play_missing(words: list[str]) -> None:
    """Play every missing score of the cells whose path has one of ``words``, or of all."""
    for name, options in SCORES.items():
        for cell in cells():
            if score_path(cell.path, name).is_file() or (
                words and not any(w in str(cell.path) for w in words)
            ):
                continue
            result = evaluate(cell.adversary, like=cell.config, episodes=1000, threads=1, **options)
            who = result.adversary.model_copy(
                update={"name": result.adversary.name.replace(f"{HERE.parent}/", "")}
            )
            write_score(
                cell.path,
                name,
                result.model_copy(update={"adversary": who, "trained_steps": cell.steps or None}),
            )
            write_page(cells())
            print(f"{cell.path.relative_to(HERE)}, {name}: {percent(result.win_rate)}", flush=True)


def ship(directory: Path, version: str = "v1") -> None:
    """Put a run's adversary into the package, with the scores it has at home."""
    source = RunCheckpoint.find(directory)
    config = source.run_dir.config()
    there = HOME / "cells" / config.env / config.method / f"s{config.seed}"
    if (there / "result.json").read_bytes() != (directory / "result.json").read_bytes():
        raise SystemExit(f"{there} is another run; first: python docs/make_campaign.py home {directory}")
    scores = {
        physics: read_score(there, name) for physics, name in (("faithful", "faithful"), ("fast", "plain"))
    }
    told = "; ".join(
        f"{score.wins} wins, {score.ties} ties in {score.episodes} games, {percent(score.win_rate)} %, {name}"
        for name, score in scores.items()
        if score
    )
    target = folder() / config.env / "adversary" / f"{version}.safetensors"
    target.parent.mkdir(parents=True, exist_ok=True)
    facts = {"score": told, "licence": "MIT, as APIL"}
    made = write(source, "safetensors", target, plugins_with(config.plugins), facts)
    print(f"{target}: {target.stat().st_size / 1000:.0f} kB, {made.provenance}")


def percent(rate: Rate) -> str:
    return f"{100 * rate.value:.1f} [{100 * rate.low:.1f}, {100 * rate.high:.1f}]"


def both(score: EvaluationResult | None) -> str:
    """Wins, and wins or ties where there are ties."""
    if score is None:
        return ""
    ties = f"; {percent(score.win_or_tie_rate)}" if score.ties else ""
    return percent(score.win_rate) + ties


def lines(cells: list[Cell], heads: list[str], columns: Any) -> list[str]:
    """A table: game, method, seed, and ``columns(cell)``; rows without content are left out."""
    rows = [
        [cell.config.env, cell.label, str(cell.config.seed) if cell.steps else "", *values]
        for cell in cells
        if any(values := columns(cell))
    ]
    head = ["game", "adversary", "seed", *heads]
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def tables(found: list[Cell]) -> list[str]:
    paper = published()

    def attacks(cell: Cell) -> list[str]:
        name = cell.config.method if cell.steps else "baseline"
        value = paper.tables[1].value(cell.config.env, name)
        share = f"{100 * cell.steps / paper.adversary_steps:.0f} %" if cell.steps else ""
        scores = [both(cell.score(score)) for score in ("plain", "faithful")]
        told = "" if value is None else f"{100 * value[0]:.0f}; {100 * value[1]:.0f}"
        steps = f"{cell.steps / 1e6:.0f} M, {share}" if cell.steps else ""
        return [steps, *scores, told] if any(scores) else []

    def ways(cell: Cell) -> list[str]:
        return [both(cell.score(name)) for name in ("unseen", "blinded", "mode", "faithful-mode")]

    def endings(cell: Cell) -> list[str]:
        score = cell.score("plain")
        causes = sorted(score.causes.items(), key=lambda item: -item[1]) if score else []
        return [
            ", ".join(f"{name} {count}" for name, count in causes),
            f"{score.mean_length:.0f}" if score else "",
        ]

    return [
        *lines(found, ["steps, share of 35 M", "`fast`", "`faithful`", "paper, table 1"], attacks),
        "",
        *lines(found, ["victim blinded", "adversary blinded", "adversary's mode", "mode, `faithful`"], ways),
        "",
        *lines(found, ["endings of 1000 games, `fast`", "mean length"], endings),
    ]


def write_page(found: list[Cell]) -> None:
    before, _, after = PAGE.read_text().partition(BEGIN)
    made = "\n".join([BEGIN, "", *tables(found), "", END])
    PAGE.write_text(f"{before}{made}{after.partition(END)[2]}")


def draw(found: list[Cell]) -> None:
    """Learning curves of the longest run of each attack: wins, ties, and the imitator's error."""
    longest: dict[tuple[str, str], Cell] = {}
    for cell in found:  # the longest come first
        if cell.steps:
            longest.setdefault((cell.config.env, cell.label), cell)
    groups = read_groups([RunDir(cell.path) for cell in longest.values()])
    for group, (game, label) in zip(groups, longest, strict=True):
        group.label = f"{label.replace('`', '')}, {game}"
        group.lines = {name: line for name, line in group.lines.items() if name in CURVES}
    draw_curves(groups, HERE / "images" / "results.png")


def main(arguments: list[str]) -> None:
    verb, rest = (arguments[0], arguments[1:]) if arguments else ("", [])
    with_runs = {"home": home, "ship": ship}
    if verb == "score":
        play_missing(rest)
    elif verb in with_runs and rest:
        for name in rest:
            with_runs[verb](Path(name))
    elif arguments:
        raise SystemExit(__doc__)
    found = cells()
    write_page(found)
    draw(found)


if __name__ == "__main__":
    main(sys.argv[1:])
