"""`--physics` as a user meets it: trained cheaply, scored under the true rules, and said so everywhere."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from apil_core.config.resolve import load_resolved
from apil_core.evaluation.video.overlay import OverlayText, header
from apil_core.evaluation.video.single_game import Frame
from apil_core.runs.distillation.config import settings as settings_of
from cli.cli_helpers import SMALL, TINY, Apil

ANTS = (
    *("--env", "sumo-ants", "--victim", "random", "--method", "adrl", "--num-envs", "4", "--steps", "64"),
    *("--set", "ppo.num_steps=16", "--set", "game.max_steps=5", "--set", "evaluation.episodes=4"),
    *("--threads", "1", "--quiet"),
)
SCORE = ("--episodes", "4", "--threads", "1", "--quiet")
FAITHFUL = {"solver": "PGS", "integrator": "RK4", "timestep": 0.003, "substeps": 5, "refresh": False}


def settings(apil: Apil, *flags: str | Path) -> dict[str, Any]:
    done = apil("eval", *flags, *SCORE, "--json")
    assert done.code == 0, done.err
    found: dict[str, Any] = json.loads(done.out)["game_settings"]
    return found


def test_trained_fast_and_scored_faithfully(apil: Apil, tmp_path: Path) -> None:
    done = apil("run", *ANTS, "--physics", "fast", "--set", "game.solver=PGS", "--out", "ants")
    assert done.code == 0, done.err
    stored = load_resolved(tmp_path / "ants").game
    assert (stored["physics"], stored["solver"], stored["integrator"]) == ("fast", "PGS", None)
    # the run's own score says what was played, and how to do better
    assert "4 games, physics custom" in done.out
    assert "solver PGS" in done.out
    assert "apil eval run:ants --physics faithful" in done.out
    result = json.loads((tmp_path / "ants" / "result.json").read_text())
    assert result["evaluation"]["game_settings"]["solver"] == "PGS"
    assert result["evaluation"]["game_options"]["physics"] == "fast"

    own = settings(apil, "ants")
    assert (own["physics"], own["solver"]) == ("custom", "PGS")
    # the profile resets the run's solver, unless one is given here too
    assert settings(apil, "ants", "--physics", "faithful") == {"physics": "faithful", **FAITHFUL}
    assert settings(apil, "ants", "--physics", "fast")["physics"] == "fast"
    newton = settings(apil, "ants", "--physics", "faithful", "--set", "game.solver=Newton")
    assert newton == {"physics": "custom", **FAITHFUL, "solver": "Newton"}

    told = apil("eval", "ants", "--physics", "faithful", *SCORE)
    assert "game       physics faithful, " in told.out
    assert "hint" not in told.out
    assert "physics faithful" not in told.out.splitlines()[0]
    told = apil("eval", "ants", "--physics", "fast", *SCORE)
    assert "hint       under the game's true physics: apil eval run:ants --physics faithful" in told.out
    assert "None" not in told.out


@pytest.mark.slow
def test_runs_of_different_physics_are_not_compared_silently(apil: Apil, tmp_path: Path) -> None:
    for name, flags in (("a", ()), ("b", ("--physics", "fast")), ("c", ("--seed", "1"))):
        assert apil("run", *ANTS, *flags, "--out", f"runs/{name}").code == 0
    listed = {row["path"]: row["physics"] for row in json.loads(apil("runs", "list", "--json").out)}
    assert listed == {"runs/a": "faithful", "runs/b": "fast", "runs/c": "faithful"}
    done = apil("runs", "compare", "runs/a", "runs/b", "--json")
    assert (
        "apil: runs differ in the game's options: physics (faithful, fast), solver (PGS, Newton)" in done.err
    )
    assert [row["physics"] for row in json.loads(done.out)["rows"]] == ["faithful", "fast"]
    # a run stored before there were profiles is the same attack as a faithful one of today
    config = tmp_path / "runs" / "c" / "config.yaml"
    lines = config.read_text().splitlines()
    inside = [line for line in lines if line.strip().split(":")[0] in (*FAITHFUL, "physics")]
    assert len(inside) == 6
    old = [line for line in lines if line not in inside or line.strip().startswith("physics")]
    known = ("solver: PGS", "integrator: RK4", "timestep: 0.003", "substeps: 5")
    place = next(i for i, line in enumerate(old) if line.strip().startswith("physics"))
    indent = old[place][: len(old[place]) - len(old[place].lstrip())]
    old[place : place + 1] = [indent + line for line in known]
    config.write_text("\n".join(old) + "\n")
    done = apil("runs", "compare", "runs/a", "runs/c", "--json")
    assert done.err == ""
    assert [spread["seeds"] for spread in json.loads(done.out)["spreads"]] == [[0, 1]]
    assert settings(apil, "runs/c") == {"physics": "faithful", **FAITHFUL}
    assert settings(apil, "runs/c", "--physics", "fast")["physics"] == "fast"


def test_compare_names_other_options_of_the_game_too(apil: Apil, trained: Path) -> None:
    other = ("--set", "game.margin=0.1", "--out", "other", "--quiet", "--json")
    assert apil("run", *TINY, *SMALL, "--method", "adrl", *other).code == 0
    done = apil("runs", "compare", trained, "other", "--json")
    assert done.err == "apil: runs differ in the game's options: margin (0.5, 0.1)\n"
    assert [row["physics"] for row in json.loads(done.out)["rows"]] == [None, None]


@pytest.mark.parametrize(
    "verb",
    [
        ("run", "--env", "toy-pursuit"),
        ("eval", "random", "--env", "toy-pursuit"),
        ("play", "random", "--env", "toy-pursuit", "--snapshots", "2"),
        ("fidelity", "--game", "toy-pursuit"),
        ("distill", "--env", "toy-pursuit", "--role", "evader"),
        ("config", "show", "--env", "toy-pursuit"),
    ],
    ids=lambda verb: verb[0],
)
def test_a_game_without_profiles_is_one_clear_line(apil: Apil, verb: tuple[str, ...], tmp_path: Path) -> None:
    done = apil(*verb, "--physics", "fast")
    assert done.code == 2
    assert len(done.err.strip().splitlines()) == 1
    assert done.err.strip().endswith("game toy-pursuit has no physics profiles")
    assert not list(tmp_path.iterdir())


def test_an_unknown_profile_is_refused(apil: Apil) -> None:
    done = apil("eval", "random", "--env", "sumo-ants", "--physics", "quick")
    assert done.code == 2
    assert "physics" in done.err
    assert "faithful" in done.err


def test_the_configuration_shows_the_profile(apil: Apil) -> None:
    done = apil("config", "show", "--env", "sumo-ants", "--physics", "fast", "--json")
    game = json.loads(done.out)["game"]
    assert (game["physics"], game["solver"], game["timestep"]) == ("fast", None, None)


def test_distillation_takes_the_profile_as_a_setting_of_the_game() -> None:
    config = settings_of(
        {"env": "sumo-ants", "role": "fighter_0", "game.physics": "fast"}, ["game.max_steps=9"]
    )
    assert config.game == {"physics": "fast", "max_steps": 9}


def test_a_video_names_physics_that_is_not_faithful() -> None:
    with_note = OverlayText("a", "b", 1, Counter(), "physics fast")
    assert "physics fast" in with_note.all(Frame(1, 2, 0.1)).splitlines()
    plain = OverlayText("a", "b", 1, Counter())
    assert "physics" not in plain.all(Frame(1, 2, 0.1))
    assert header(400, 16, with_note).tobytes() != header(400, 16, plain).tobytes()


def test_pairings_are_played_in_the_profile(
    apil: Apil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "matched_ants.py").write_text(
        "from dataclasses import replace\n"
        "from apil_core import Matchup, hookimpl\n"
        "import apil_envs.plugin\n"
        "from apil_envs.options import SumoOptions\n"
        "class Short(SumoOptions):\n"
        "    max_steps: int = 5\n"
        "@hookimpl\n"
        "def register_games():\n"
        "    noise = 'baseline:random/137x8'\n"
        "    ants = next(spec for spec in apil_envs.plugin.register_games() if spec.name == 'sumo-ants')\n"
        "    short = {'name': 'ants', 'config': 'matched_ants:Short', 'matchups': (Matchup(noise, noise),)}\n"
        "    return [replace(ants, **short)]\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    flags = ("--plugin", "matched_ants.py", "--game", "ants", "--episodes", "2", "--threads", "1", "--quiet")
    done = apil("fidelity", *flags, "--physics", "fast", "--out", "rows.jsonl", "--json")
    assert done.code == 0, done.err
    (row,) = json.loads(done.out)["rows"]
    assert (row["plan"]["kind"], row["plan"]["options"]) == ("profile", {"physics": "fast"})
    assert row["result"]["game_settings"]["physics"] == "fast"
    kept = (tmp_path / "rows.jsonl").read_text()
    assert apil("fidelity", *flags, "--physics", "fast", "--out", "rows.jsonl").code == 0
    assert (tmp_path / "rows.jsonl").read_text() == kept  # taken, not played again
