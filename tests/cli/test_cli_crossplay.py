"""``apil crossplay`` and ``apil analyze activations`` as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.cli_helpers import COIN, Apil

CROSS = ("crossplay", "--env", "coin", "--plugin", COIN, "--threads", "1", "--episodes", "20")
PLAYERS = ("--adversaries", "random,zero", "--victims", "auto,random", "--victim-labels", "original,noise")
ANALYZE = ("analyze", "activations", "--env", "toy-pursuit", "--baseline", "zero", "--threads", "1")
FEW = ("--games", "4", "--steps", "10", "--points", "12", "--perplexity", "3", "--components", "1")


def test_the_table_has_every_pairing(apil: Apil, tmp_path: Path) -> None:
    picture = tmp_path / "map.png"
    done = apil(*CROSS, *PLAYERS, "--labels", "noise,[x]", "--picture", picture)
    assert done.code == 0, done.err
    for word in ("noise", "[x]", "original", "win+tie", "20 games a cell", "baseline:zero/2x1", "≈↑", "≈←"):
        assert word in done.out, word
    assert "4 of 4 pairings: [x] against noise: win " in done.err
    assert picture.read_bytes().startswith(b"\x89PNG")
    again = apil(*CROSS, *PLAYERS, "--picture", picture)
    assert (again.code, again.out) == (2, "")
    assert "map.png exists already; choose another name, or --force" in again.err
    assert apil(*CROSS, *PLAYERS, "--picture", picture, "--force", "--quiet").code == 0


def test_a_second_call_plays_nothing_again(apil: Apil, tmp_path: Path) -> None:
    out = tmp_path / "scores.json"
    first = apil(*CROSS, *PLAYERS, "--out", out, "--json", "--quiet")
    assert (first.code, first.err) == (0, "")
    told = json.loads(first.out)
    assert len(told["comparisons"]) == 2 * 4
    assert [len(row) for row in told["scores"]] == [2, 2]
    kept = out.read_bytes()
    second = apil(*CROSS, *PLAYERS, "--out", out, "--json")
    assert (second.err, json.loads(second.out)["scores"]) == ("", told["scores"])
    assert out.read_bytes() == kept
    refused = apil(*CROSS, *PLAYERS, "--out", out, "--seed", "1")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert "seed 0, this call has 1" in refused.err


def test_a_map_goes_to_a_directory(apil: Apil, tmp_path: Path) -> None:
    done = apil(*ANALYZE, *FEW, "random", "--out", tmp_path / "map")
    assert done.code == 0, done.err
    for word in ("baseline", "random", "log-likelihood", "4 other games of normal play", "1 components"):
        assert word in done.out, word
    told = json.loads((tmp_path / "map" / "activations.json").read_text())
    assert told["opponents"] == ["baseline", "random"]
    assert (tmp_path / "map" / "activations.png").read_bytes().startswith(b"\x89PNG")
    again = apil(*ANALYZE, *FEW, "random", "--out", tmp_path / "map")
    assert again.code == 2
    assert "exists already; choose another name, or --force" in again.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*CROSS, "--adversaries", "random,", "--victims", "auto"), "an empty word between commas"),
        ((*CROSS, "--adversaries", "random", "--victims", "nope:x"), "unknown policy 'nope:x'"),
        ((*CROSS, "--adversaries", "random,random", "--victims", "auto"), "two players are called 'random'"),
        ((*CROSS, *PLAYERS, "--labels", "a"), "1 labels for 2 names: one for each adversary"),
        ((*CROSS, *PLAYERS, "--out", "no/x.json"), "its directory does not exist"),
        ((*CROSS, *PLAYERS, "--picture", "map.gif"), ".png, .svg or .pdf"),
        ((*ANALYZE, "random", "--victim", "zero"), "is a black box: it does not tell its activations"),
        ((*ANALYZE, "random", "--out", "no/x.json"), "its directory does not exist"),
        ((*ANALYZE, "random", "--games", "1"), "games must be at least 2, got 1"),
    ],
    ids=str,
)
def test_a_mistake_is_one_line(apil: Apil, arguments: tuple[str, ...], message: str) -> None:
    done = apil(*arguments)
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert message in done.err
