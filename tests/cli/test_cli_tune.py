"""``apil tune`` as a user meets it."""

from __future__ import annotations

import json

import pytest

from cli.cli_helpers import SMALL, TINY

pytest.importorskip("optuna")
STUDY = (*TINY, *SMALL, "--method", "adrl", "--set", "evaluation.periodic_episodes=10", "--quiet")


@pytest.fixture
def space(tmp_path):
    file = tmp_path / "space.yaml"
    file.write_text("ppo.learning_rate: {low: 1e-5, high: 1e-2, log: true}\nppo.noise: [white, ar1]\n")
    return file


def test_a_study_prints_its_trials_and_is_continued_by_its_directory(apil, space, tmp_path):
    done = apil("tune", space, *STUDY, "--trials", "2", "--out", "study", "--json")
    assert (done.code, done.err) == (0, "")
    document = json.loads(done.out)
    assert [row["state"] for row in document["rows"]] == ["complete", "complete"]
    assert document["scores"]["best"]["episodes"] == 20
    assert document["best"]["evaluation"]["episodes"] == 20
    more = apil("tune", "study", "--trials", "3")
    assert more.code == 0, more.err
    assert "\ntrial 2 complete, " in more.err
    assert "of 20 other games won" in more.out
    assert "study/best.yaml (trial " in more.out
    listed = apil("runs", "list", "study")
    assert listed.out.count("finished") == 3
    again = apil("run", "--config", "study/best.yaml", "--out", "again", "--quiet", "--json", "--trust")
    score = json.loads(apil("tune", "study", "--json").out)["scores"]["best"]
    assert json.loads(again.out)["evaluation"]["wins"] == score["wins"]


def test_what_a_flag_says_is_not_varied(apil, space):
    done = apil("tune", space, *STUDY, "--set", "ppo.noise=ar1", "--dry-run", "--json")
    assert list(json.loads(done.out)["space"]) == ["ppo.learning_rate"]


def test_a_dry_run_writes_nothing(apil, space, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    done = apil("tune", space, *STUDY, "--dry-run")
    assert done.code == 0, done.err
    assert "ppo.noise: ['white', 'ar1']" in done.out
    assert "20 trials of adrl on coin, 256 steps each" in done.out
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("adrll",), "no space that ships with apil (did you mean 'adrl'?"),
        (("adrl", "--trials", "0"), "--trials must be at least 1, got 0"),
        (("adrl", "--env", "toy-pursui"), "--env toy-pursui: unknown game 'toy-pursui' (did you mean"),
        (("adrl", "--set", "ppo.gama=1"), "--set ppo.gama=1: unknown key (did you mean 'gamma'?)"),
        ((".",), ". is no study (no settings.yaml in it)"),
        ((".", "--steps", "3"), ". has its settings already"),
    ],
    ids=lambda case: " ".join(case) if isinstance(case, tuple) else "",
)
def test_a_mistake_is_one_line(apil, arguments, line):
    done = apil("tune", *arguments)
    assert done.code == 2
    assert len(done.err.splitlines()) == 1
    assert line in done.err
