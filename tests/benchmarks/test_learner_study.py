"""The study of the learner: its preset is the one that ships, and the page shows what was measured."""

from __future__ import annotations

import json

import pytest
from docs.pages import ROOT
from helpers.small_runs import small_config
from ruamel.yaml import YAML

from apil_core import run
from apil_core.config.layers import preset_layer
from apil_core.config.resolve import flatten, resolve
from apil_core.plugins.registry import default_plugins

FOLDER = ROOT / "benchmarks" / "learner"


@pytest.fixture
def study(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import learner_study  # type: ignore[import-not-found]

    return learner_study


def test_what_the_variants_change_is_the_preset():
    plugins = default_plugins()
    stated = YAML(typ="safe").load((FOLDER / "variants.yaml").read_text())["efficient"]
    preset = flatten(resolve(presets=["efficient"], flags={"method": "adrl"}, plugins=plugins).model_dump())
    assert {key: preset[key] for key in stated} == stated
    plain = flatten(resolve(flags={"method": "adrl"}, plugins=plugins).model_dump())
    changed = {
        key for key in preset if preset[key] != plain[key] and key.startswith(("ppo.", "reward.", "num"))
    }
    assert changed <= set(stated)


def test_the_variant_of_sumo_ants_is_its_preset():
    stated = YAML(typ="safe").load((FOLDER / "variants.yaml").read_text())["untouched"]
    assert {"env": "sumo-ants", **stated} == flatten(preset_layer("sumo-ants").data)


def test_a_run_is_summed_up(study, tmp_path):
    out = tmp_path / "kick-and-defend" / "adrl-white-s3"
    run(small_config("adrl", steps=8 * 8192, num_envs=512, evaluation={"episodes": 20}), out=out)
    found = study.summary(out)
    assert (found["game"], found["method"], found["variant"], found["seed"]) == (
        *("kick-and-defend", "adrl", "white"),
        3,
    )
    assert found["wins"] == {}
    assert found["episodes"] == 20
    cells = [cell.strip() for cell in study.row(found).split("|")[1:-1]]
    assert cells[:4] == ["kick-and-defend", "adrl", "white", "3"]
    assert len(cells) == study.HEAD.count("|") - 1


def test_the_page_shows_what_was_measured(study):
    found = json.loads((ROOT / "docs" / "results" / "learner" / "runs.json").read_text())
    rows = [study.row(each) for each in found]
    text = (ROOT / "docs" / "learner.md").read_text("utf-8").splitlines()
    assert rows
    assert [row for row in rows if row not in text] == []


def test_rows_of_earlier_runs_are_kept(study):
    found = json.loads((ROOT / "docs" / "results" / "learner" / "runs.json").read_text())
    assert study.merged(found, []) == found
    longer, other = found[0] | {"steps": 9e9}, found[1] | {"seed": 99}
    assert study.merged(found, [longer])[0] == longer
    assert study.merged([longer], found)[0] == longer
    assert len(study.merged(found, [other])) == len(found) + 1
