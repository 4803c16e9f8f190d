"""docs/metrics.md names every metric that real runs log, and no other."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from helpers.small_runs import small_config
from retraining.victims import student

from apil_core import Method, MethodSpec, Rollout, hookimpl, retrain, run
from apil_core.runs.distillation.report import Report
from apil_core.runs.retraining.session import RetrainResult
from docs.pages import ROOT, sections

PAGE = ROOT / "docs" / "metrics.md"


class Relabelling(Method):
    """Changes the main reward, and logs a metric of its own."""

    @hookimpl
    def relabel_reward(self, rollout: Rollout, reward: Any) -> Any:
        return reward + 1

    @hookimpl
    def update_auxiliary(self, rollout: Rollout) -> dict[str, float]:
        return {"mine": 1.0}


APIL: dict[str, Any] = {"apil": {"imitator": {"objective": "both", "update": "trpo"}}}
RUNS = {
    "adrl": small_config("adrl", log_rows=2),
    "apl": small_config("apl", options={"apl": {"advantage_difference": True}}),
    "apil": small_config("apil", steps=512, options=APIL),
    "e_apil": small_config("e_apil", steps=512, evaluation={"episodes": 4}),
    "scored": small_config("adrl", steps=512, evaluation={"every_steps": 512, "periodic_episodes": 4}),
}


@pytest.fixture(scope="module")
def directories(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Small runs by name, one with each thing that adds metrics."""
    place = tmp_path_factory.mktemp("metrics")
    victim = student(place / "evader.safetensors")
    for name, config in RUNS.items():
        run(config.model_copy(update={"victim": victim}), out=place / name)
    made = [MethodSpec("relabelling", Relabelling)]
    run(small_config("relabelling", steps=512), methods=made, out=place / "relabelling")
    flags = {"steps": 4 * 512, "baseline": "random", "critic_warmup": 0, "recorders": ["jsonl"]}
    flags |= {"num_envs": 32, "ppo": {"num_steps": 16}}
    scores = {"every_steps": 1024, "periodic_episodes": 4, "episodes": 4}
    retrain([place / "scored"], out=place / "retrained", **flags, evaluation=scores)
    return {path.name: path for path in place.iterdir() if path.is_dir()}


def names_in(section: str) -> set[str]:
    """Code in the first column of a section's tables."""
    rows = re.findall(r"^\| (`.+?) \|", sections(PAGE)[section], re.M)
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


def documented() -> set[str]:
    return {name for title in sections(PAGE) if title.startswith("Rows: ") for name in names_in(title)}


def row_of(name: str, rows: set[str]) -> str | None:
    """The row that a metric belongs to: of those it fits, ``<…>`` standing for a part, the longest."""
    row = {row.replace("<plugin>", "relabelling"): row for row in rows}  # not every plugin, or all would fit
    fits = [each for each in row if re.fullmatch(re.sub(r"<\w+>", "[^/]+", each), name)]
    return row[max(fits, key=len)] if fits else None


def test_every_logged_metric_is_on_the_page_and_every_one_there_is_logged(
    directories: dict[str, Path],
) -> None:
    logged: set[str] = set()
    for path in directories.values():
        for line in (path / "metrics.jsonl").read_text().splitlines():
            logged |= json.loads(line).keys()
    rows = documented()
    found = {name: row_of(name, rows) for name in logged}
    assert [name for name, row in found.items() if row is None] == []
    assert rows - set(found.values()) == set()


def test_every_key_of_a_result_is_on_the_page(directories: dict[str, Path]) -> None:
    result = json.loads((directories["e_apil"] / "result.json").read_text())
    assert names_in("The result of a run: result.json") == set(result)
    assert names_in("A score") == set(result["evaluation"])
    hardened = json.loads((directories["retrained"] / "result.json").read_text())
    assert names_in("Retraining: result.json") == set(hardened) == set(RetrainResult.model_fields)
    assert names_in("Distillation: report.json") == set(Report.model_fields)
