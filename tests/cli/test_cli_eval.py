"""`apil eval`: options of the game, and blinding."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.cli_helpers import COIN, Apil

RANDOM = ("baseline:random/7x2", "--env", "toy-pursuit", "--episodes", "20", "--threads", "1", "--quiet")


def test_an_option_of_the_game_is_used_and_recorded(apil: Apil) -> None:
    done = apil("eval", *RANDOM, "--set", "game.max_steps=4", "--json")
    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["game_options"] == {"max_steps": 4}
    assert result["causes"] == {"time-up": 20}
    assert result["mean_length"] == 4
    assert "game       max_steps 4" in apil("eval", *RANDOM, "--set", "game.max_steps=4").out


def test_an_option_of_a_runs_game_too_and_the_others_stay(apil: Apil, trained: Path) -> None:
    own = json.loads(apil("eval", trained, "--episodes", "20", "--quiet", "--json").out)
    assert own["game_options"] == {"margin": 0.5}
    done = apil("eval", trained, "--episodes", "20", "--quiet", "--json", "--set", "game.margin=1000")
    other = json.loads(done.out)
    assert (other["game_options"], other["causes"]) == ({"margin": 1000.0}, {"even": 20})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("game.max_step=3", "--set game.max_step=3: unknown key (did you mean 'max_steps'?)"),
        ("game.max_steps=0", "--set game.max_steps=0: should be greater than 0, got 0"),
        ("max_steps=3", "--set max_steps=3: unknown key (did you mean 'game.max_steps'?)"),
        ("steps=3", "--set steps=3: unknown key (known: game)"),
        ("game.max_steps", "--set game.max_steps: expected key=value, e.g. ppo.epochs=8"),
    ],
)
def test_a_wrong_option_is_one_line(apil: Apil, text: str, message: str) -> None:
    done = apil("eval", *RANDOM, "--set", text)
    assert (done.code, done.out, done.err) == (2, "", f"apil: {message}\n")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--seed", "-1"], "seed must be at least 0, got -1"),
        (["--num-envs", "0"], "num_envs must be at least 1, got 0"),
        (["--checkpoint", "x"], "baseline:random/7x2 is no run: there is no checkpoint to choose"),
    ],
)
def test_a_number_out_of_range_is_one_line(apil: Apil, flags: list[str], message: str) -> None:
    done = apil("eval", *RANDOM, *flags)
    assert (done.code, done.out, done.err) == (2, "", f"apil: {message}\n")


@pytest.mark.parametrize("mode", ["zeros", "initial"])
def test_blinding_is_shown_and_recorded(apil: Apil, mode: str) -> None:
    plain = json.loads(apil("eval", *RANDOM, "--json").out)
    assert (plain["blind"], plain["blind_imitator"]) == (None, False)
    result = json.loads(apil("eval", *RANDOM, "--blind", mode, "--json").out)
    assert (result["blind"], result["blind_imitator"]) == (mode, False)
    shown = apil("eval", *RANDOM, "--blind", mode, "--blind-imitator").out
    assert f"blinded    the adversary does not see its opponent ({mode}), its methods too" in shown
    assert "blinded" not in apil("eval", *RANDOM).out


def test_a_run_can_be_blinded(apil: Apil, trained: Path) -> None:
    done = apil("eval", trained, "--episodes", "20", "--quiet", "--json", "--blind", "zeros")
    assert (done.code, json.loads(done.out)["blind"]) == (0, "zeros")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--blind-imitator"], "--blind-imitator needs --blind zeros or --blind initial"),
        (["--blind", "zero"], 'Invalid value "zero" for --blind. Choose from: "zeros", "initial".'),
    ],
)
def test_wrong_blinding_is_one_line(apil: Apil, flags: list[str], message: str) -> None:
    done = apil("eval", *RANDOM, *flags)
    assert done.code == 2
    assert message in done.err
    assert len(done.err.splitlines()) == 1


def test_a_game_that_names_no_channels_cannot_be_blinded(apil: Apil, tmp_path: Path) -> None:
    mute = tmp_path / "mute_coin.py"
    text = COIN.read_text().replace("(1,)) for name", "()) for name").replace("coin_game:", "mute_coin:")
    mute.write_text(text)
    flags = ("--env", "coin", "--plugin", mute, "--episodes", "4", "--quiet", "--blind", "zeros")
    done = apil("eval", "baseline:random/2x1", *flags)
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert "cannot blind the right: game 'coin' does not say which of its observation's channels" in done.err


def test_a_score_is_kept_with_its_run(apil: Apil, trained: Path) -> None:
    done = apil("eval", trained, "--episodes", "20", "--quiet", "--json", "--keep", "again")
    assert done.code == 0, done.err
    assert json.loads((trained / "scores" / "again.json").read_text()) == json.loads(done.out)
    for name, reason in (
        ("again", "again.json exists, and no score is over"),
        ("plain", "that is the score the run"),
        ("a/b", "--keep a/b: a name is made of letters, digits and . _ -"),
    ):
        refused = apil("eval", trained, "--episodes", "20", "--keep", name)
        assert refused.code == 2
        assert reason in refused.err


@pytest.mark.parametrize(
    ("who", "name", "message"),
    [
        (RANDOM[0], "a", "--keep a: baseline:random/7x2 is no run; name a file, e.g. --keep a.json"),
        (RANDOM[0], "no/no/a.json", "no/no: its directory does not exist"),
    ],
)
def test_a_score_that_cannot_be_kept_is_one_line(apil: Apil, who: str, name: str, message: str) -> None:
    done = apil("eval", who, *RANDOM[1:], "--keep", name)
    assert (done.code, done.out, done.err) == (2, "", f"apil: {message}\n")


DIM = """
from apil_core import Observer, ObserverSpec, Section, hookimpl

APIL_HOOK_API = 1


class Options(Section):
    by: float = 0.5


class Dim(Observer):
    @hookimpl
    def filter_observation(self, context, obs):
        return obs * self.options.by if context.role == "victim" else None


@hookimpl
def register_observers():
    return [ObserverSpec("dim", f"{__name__}:Dim", "dims the victim's view", config=f"{__name__}:Options")]
"""


def test_an_observer_is_switched_on_and_shown(apil: Apil, tmp_path: Path) -> None:
    (tmp_path / "dimmer.py").write_text(DIM)
    flags = ("--plugin", tmp_path / "dimmer.py", "--observer", "dim", "--set", "options.dim.by=0")
    done = apil("eval", *RANDOM, *flags, "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["observers"] == {"dim": {"by": 0.0}}
    assert "observer   dim (by=0.0)" in apil("eval", *RANDOM, *flags).out
    assert "dims the victim's view" in apil("observers", *flags[:2]).out
    wrong = apil("eval", *RANDOM, *flags[:-1], "options.dim.buy=0")
    assert wrong.err == "apil: --set options.dim.buy=0: unknown key (did you mean 'by'?)\n"
