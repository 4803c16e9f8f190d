"""``apil fidelity`` as a user meets it, on the coin game with a made-up published score."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.cli_helpers import COIN, Apil

MATCHED = """\
from dataclasses import replace

import coin_game

from apil_core import Matchup, PublishedScore, hookimpl


@hookimpl
def register_games():
    score = PublishedScore(50, 60, 100, "made up", adversary_actions="mode", victim_actions="mode")
    noise = "baseline:random/2x1"
    return [
        replace(
            spec,
            name="matched",
            matchups=(
                Matchup("zoo:kick-and-defend/kicker/v1", noise, score),
                Matchup(noise, noise, score, stands_in_for="zoo:kick-and-defend/kicker/v1"),
            ),
        )
        for spec in coin_game.register_games()
    ]
"""

SMALL = ("--game", "matched", "--episodes", "20", "--switch-episodes", "10", "--threads", "1")


@pytest.fixture
def flags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    monkeypatch.syspath_prepend(str(COIN.parent))
    file = tmp_path / "matched.py"
    file.write_text(MATCHED)
    monkeypatch.delitem(__import__("sys").modules, "matched", raising=False)
    return ("--plugin", str(COIN), "--plugin", str(file), *SMALL)


def test_the_table_says_what_was_measured_and_what_published(apil: Apil, flags: tuple[str, ...]) -> None:
    done = apil("fidelity", *flags)
    assert done.code == 0, done.err
    assert "baseline:random/2x1*" in done.out
    for word in ("sampled/sampled", "mode/mode", "win+tie", "50 %", "60 %", "margin", "mean length 5"):
        assert word in done.out, word
    assert "* baseline:random/2x1 stands in for zoo:kick-and-defend/kicker/v1" in done.out
    assert "skipped matched, zoo:kick-and-defend/kicker/v1: " in done.out
    assert "apil victims download" in done.out
    assert "2 of 2 rows: matched, baseline:random/2x1 against baseline:random/2x1, mode/mode" in done.err


def test_json_holds_every_row_and_what_was_skipped(apil: Apil, flags: tuple[str, ...]) -> None:
    done = apil(
        "fidelity", *flags, "--switches", "--variant", "margin=0.1,victim_actions=mode", "--json", "--quiet"
    )
    assert (done.code, done.err) == (0, "")
    told = json.loads(done.out)
    kinds = [row["plan"]["kind"] for row in told["rows"]]
    assert kinds == ["default", "as-published", "switch", "switch", "variant"]
    assert told["rows"][-1]["result"]["game_options"] == {"margin": 0.1}
    for row in told["rows"]:
        assert row["win"]["verdict"].startswith(("agrees: ", "differs by "))
        assert row["win"]["measured"]["low"] <= row["result"]["win_rate"]["value"]
        assert row["plan"]["stands_in_for"] == "zoo:kick-and-defend/kicker/v1"
    assert [skipped["adversary"] for skipped in told["skipped"]] == ["zoo:kick-and-defend/kicker/v1"]


def test_a_second_call_plays_nothing_again(apil: Apil, flags: tuple[str, ...], tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    first = apil("fidelity", *flags, "--out", out, "--json")
    kept = out.read_text()
    second = apil("fidelity", *flags, "--out", out, "--json")
    assert (second.out, second.err) == (first.out, "")
    assert out.read_text() == kept
    refused = apil("fidelity", *flags, "--out", out, "--seed", "1")
    assert refused.code == 2
    assert refused.err.count("\n") == 1
    assert "seed 0, this call has 1" in refused.err
    assert out.read_text() == kept


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--game", "sumo-ant"), "unknown game 'sumo-ant' (did you mean 'sumo-ants'?"),
        (("--episodes", "0"), "episodes must be at least 1, got 0"),
        (("--game", "toy-pursuit", "--variant", "solver"), "--variant solver: expected key=value"),
        (("--game", "toy-pursuit", "--out", "no/rows.jsonl"), "its directory does not exist"),
    ],
    ids=str,
)
def test_a_mistake_is_one_line(apil: Apil, arguments: tuple[str, ...], message: str) -> None:
    done = apil("fidelity", *arguments)
    assert done.code == 2
    assert done.out == ""
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert message in done.err


def test_a_game_without_pairings_is_no_mistake(apil: Apil) -> None:
    done = apil("fidelity", "--game", "toy-pursuit")
    assert (done.code, done.err) == (0, "")
    assert "nothing played" in done.out
