"""``apil retrain`` as a user meets it."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from retraining.victims import runner

from apil_core.cli.progress import ConsoleProgress
from apil_core.runs.retraining.settings import settings
from cli.cli_helpers import COIN, Apil

FLAGS = (
    *("--env", "toy-pursuit", "--baseline", "random", "--steps", "1024", "--num-envs", "32"),
    *("--threads", "1", "--episodes", "20", "--set", "ppo.num_steps=16", "--set", "ppo.minibatches=2"),
    *("--set", "recorders=[jsonl]", "--set", "critic_warmup=0"),
)


@pytest.fixture
def players(tmp_path: Path) -> tuple[str, ...]:
    """Who attacks, and ``--victim`` with who is hardened."""
    victim = runner(tmp_path / "slow.safetensors", "gate", 0.8)
    return runner(tmp_path / "chaser.safetensors", "opponent", 0.35), "--victim", victim


def test_ctrl_c_then_resume_then_attack(
    apil: Apil, players: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Impatient(ConsoleProgress):
        def iteration(self, metrics: dict[str, float]) -> None:
            os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr("apil_core.cli.retrain.make_progress", lambda quiet: Impatient())
        stopped = apil("retrain", *players, *FLAGS, "--out", "hard")
    assert (stopped.code, stopped.out) == (130, "")
    assert stopped.err == "apil: interrupted at 512 steps; continue with: apil resume hard\n"

    done = apil("resume", "hard")
    assert done.code == 0, done.err
    for word in ("retrained 1,024 steps", "chaser", "baseline", "before", "after", "wins or ties"):
        assert word in done.out, word
    assert done.out.endswith("victim     retrained:hard\ncurve      hard/curve.png\n")
    assert "chaser 50 %, baseline 50 % in toy-pursuit, seed 0" in done.err
    assert "chaser against the victim:\nevaluation after 1,024 steps, 20 games: win " in done.err
    assert " victim's win " in done.err

    again = apil("resume", "hard")
    assert (again.code, again.err.count("\n")) == (2, 1)
    assert "hard is finished at 1024 steps; to extend it: apil resume hard --steps N" in again.err
    longer = apil("resume", "hard", "--steps", "1536", "--quiet", "--json")
    assert (longer.code, longer.err) == (0, "")
    told = json.loads(longer.out)
    assert (told["steps"], told["shares"]) == (1536, {"chaser": 0.5, "baseline": 0.5})
    assert {"curve.png", "curve-1024.png"} <= {path.name for path in (tmp_path / "hard").iterdir()}

    attack = ("eval", players[0], "--env", "toy-pursuit", "--victim", "hard", "--episodes", "20")
    score = json.loads(apil(*attack, "--threads", "1", "--quiet", "--json").out)
    assert score["victim"] == told["hardened"]
    assert score["wins"] == told["after"]["chaser"]["wins"]

    drawn = apil("runs", "plot", "hard", "--json")
    assert drawn.code == 0, drawn.err
    groups = json.loads(drawn.out)["groups"]
    assert [group["label"] for group in groups] == ["chaser", "baseline"]
    steps = [point["steps"] for point in groups[0]["curves"][0]["scores"]]
    assert steps == [0, 1024, 1536]
    for flags, message in (
        (("hard",), "hard is a retraining: draw it alone"),
        (("--metric", "ppo/kl"), "hard is a retraining: its picture has no panel for --metric"),
    ):
        refused = apil("runs", "plot", "hard", *flags, "--out", "other.png")
        assert (refused.code, refused.err) == (2, f"apil: {message}\n")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"RUN": None}, "parameter RUN requires an argument"),
        ({"RUN": "nowhere"}, "nowhere is neither a run directory nor a policy name"),
        ({"RUN": "torchscript:none.pt"}, "none.pt"),
        ({"RUN": "torch-export:none.pt2"}, "none.pt2"),
        ({"--plugin": "nowhere.py"}, "nowhere.py"),
        ({"--share": "1"}, "--share"),
        ({"--adversary-share": "2"}, "--adversary-share 2.0: should be less than or equal to 1"),
        ({"--set": "frezze=value"}, "unknown key (did you mean 'freeze'?)"),
        ({"--set": "recorders=[tape]"}, "unknown recorder 'tape'"),
        ({"--baseline": "auto"}, "toy-pursuit has no baseline adversary for the pursuer"),
        ({"--victim": "random"}, "cannot be retrained; what can: zoo:"),
        ({"--steps": "0"}, "--steps 0: should be greater than 0"),
        ({"--steps": "160k"}, "leave safetensors:"),
        (
            {"--steps": "160k"},
            "the first 10 iterations of 16,384 steps train the critic alone (critic_warmup)",
        ),
        (
            {"--set": "ppo.init_std=0.1"},
            "--set ppo.init_std=0.1: is no setting of a retraining: the victim has its own",
        ),
        ({"--out": "."}, "exists and is not empty"),
    ],
    ids=str,
)
def test_a_mistake_is_one_line_and_makes_nothing(
    apil: Apil, players: tuple[str, ...], tmp_path: Path, changes: dict[str, str | None], message: str
) -> None:
    adversary, victim, hardened = players
    words = {"RUN": adversary, victim: hardened, "--env": "toy-pursuit", "--baseline": "random"}
    flags = {**words, "--out": "made", **changes}
    given = [word for item in flags.items() for word in item if word not in ("RUN", None)]
    done = apil("retrain", *given)
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert message in done.err
    assert not (tmp_path / "made").exists()


def test_a_policys_file_is_no_checkpoint_of_a_run() -> None:
    for scheme, file in (("torchscript", "x.pt"), ("torch-export", "x.pt2")):
        found = settings([f"{scheme}:{file}"], {"env": "toy-pursuit"})
        assert (found.adversaries, found.labels) == ((f"{scheme}:{file}",), ("x", "baseline"))


def test_a_game_of_a_plugin_that_is_named(tmp_path: Path) -> None:
    found = settings(["baseline:random/2x1"], {"env": "coin", "victim": "zero"}, plugin_files=[COIN])
    assert (found.env, found.plugins) == ("coin", (str(COIN),))
