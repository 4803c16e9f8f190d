"""Policies of other people on the command line: checked, trusted, scored, attacked; adversaries exported."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from policies.foreign_files import Gaussian, Recurrent, save

from cli.cli_helpers import Apil

pytest.importorskip("onnxruntime", reason="needs the extra onnx: pip install -e '.[onnx]'")

TOY = ("--env", "toy-pursuit")
SHORT = (
    *TOY,
    *("--method", "adrl", "--steps", "1k", "--num-envs", "16", "--threads", "1", "--quiet"),
    *("--set", "ppo.num_steps=16", "--set", "ppo.epochs=1", "--set", "evaluation.episodes=8"),
)

AGENT = """
def flee(observation):
    return -observation[:, 2:4].clamp(-1, 1)

def broken(observation):
    raise KeyError("no such thing")
"""


@pytest.fixture
def agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A callable in the current directory."""
    (tmp_path / "an_agent.py").write_text(AGENT)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield "python:an_agent:flee"
    sys.modules.pop("an_agent", None)


def test_an_onnx_policy_is_attacked_and_scored(apil: Apil, tmp_path: Path) -> None:
    save(Recurrent(), tmp_path / "their.onnx", {"state": [5, 5]})
    done = apil("run", *SHORT, "--victim", "onnx:their.onnx", "--out", "r", "--json")
    assert done.code == 0, done.err
    name = f"onnx:{tmp_path}/their.onnx"
    assert json.loads(done.out)["evaluation"]["victim"]["name"] == name
    assert f"victim: {name}\n" in (tmp_path / "r" / "config.yaml").read_text()
    assert apil("resume", "r", "--steps", "2k", "--quiet").code == 0
    scored = apil("eval", "onnx:their.onnx", *TOY, "--episodes", "10", "--quiet", "--json")
    assert scored.code == 0, scored.err
    assert json.loads(scored.out)["adversary"]["name"] == name


def test_check_tells_what_a_policy_is(apil: Apil, tmp_path: Path) -> None:
    save(Gaussian(), tmp_path / "their.onnx")
    done = apil("victims", "check", "onnx:their.onnx", *TOY, "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert found["name"] == f"onnx:{tmp_path}/their.onnx"
    assert (found["game"], found["side"]) == ("toy-pursuit", "evader")
    assert (found["observation_size"], found["action_size"]) == (7, 2)
    assert (found["recurrent"], found["stochastic"], found["errors"]) == (False, True, [])
    assert found["steps_per_second"] > 1000
    text = apil("victims", "check", "onnx:their.onnx", *TOY, "--side", "pursuer").out
    assert "seat          pursuer of toy-pursuit" in text
    assert "it can take this seat" in text


@pytest.mark.parametrize("name", ["random", "zero", "scripted:toy-pursuit/evader/v1"])
def test_check_takes_any_name(apil: Apil, name: str) -> None:
    assert apil("victims", "check", name, *TOY).code == 0


def test_check_tells_why_a_policy_does_not_fit(apil: Apil, tmp_path: Path) -> None:
    save(Gaussian(), tmp_path / "their.onnx", {"action_bounds": [-2, 2]})
    done = apil("victims", "check", "onnx:their.onnx", *TOY, "--json")
    assert done.code == 2
    assert json.loads(done.out)["errors"] == ["made for actions in [-2, 2], but the evader's are in [-1, 1]"]
    shown = apil("victims", "check", "baseline:zero/9x3", *TOY)
    assert shown.code == 2
    assert "error:        takes 9 observations and gives 3 actions, but the evader has 7 and 2" in shown.out
    missing = apil("victims", "check", "onnx:nowhere", *TOY)
    assert (missing.code, missing.err.count("\n")) == (2, 1)
    wrong = apil("victims", "check", "zero", *TOY, "--side", "goalie")
    assert "unknown side of toy-pursuit 'goalie' (known: evader, pursuer)" in wrong.err


def test_naming_code_on_the_command_line_is_trusting_it(apil: Apil, tmp_path: Path, agent: str) -> None:
    for number, named in enumerate((("--victim", agent), ("--set", f"victim={agent}"))):
        done = apil("run", *SHORT, *named, "--out", f"r{number}")
        assert done.code == 0, done.err
    assert apil("resume", "r0", "--steps", "2k", "--quiet").code == 0
    assert apil("eval", "r0", "--episodes", "4", "--quiet").code == 0
    assert apil("eval", agent, *TOY, "--episodes", "4", "--quiet").code == 0
    assert apil("eval", "random", "--victim", agent, *TOY, "--episodes", "4", "--quiet").code == 0
    assert apil("victims", "check", agent, *TOY).code == 0


def test_no_file_vouches_for_itself(apil: Apil, tmp_path: Path, agent: str) -> None:
    (tmp_path / "run.yaml").write_text(f"victim: {agent}\ntrust: true\n")
    flags = ("run", *SHORT, "--config", "run.yaml", "--out", "r")
    done = apil(*flags)
    assert done.code == 2
    assert done.err == (
        f"apil: {agent} runs code when it is loaded, and run.yaml names it: name it on the command line, or "
        "add --trust if you trust that (once also for your runs older than this check; "
        "Python: apil_core.trust)\n"
    )
    assert "an_agent" not in sys.modules
    done = apil(*flags, "--trust")
    assert done.code == 0
    assert done.err.startswith(f"apil: loads code: {agent}, named by run.yaml (as asked)\n")
    # own runs go on without asking, copied ones do not
    done = apil("resume", "r", "--steps", "2k", "--quiet")
    assert done.err.startswith(f"apil: loads code: {agent}, named by r/config.yaml (run there before)\n")
    shutil.copytree(tmp_path / "r", tmp_path / "copy")
    assert apil("resume", "copy", "--steps", "3k", "--quiet").code == 2
    assert apil("eval", "copy", "--episodes", "4", "--quiet").code == 2
    assert apil("eval", "copy", "--episodes", "4", "--quiet", "--victim", agent).code == 0
    assert apil("resume", "copy", "--steps", "3k", "--quiet", "--trust").code == 0
    assert apil("resume", "copy", "--steps", "4k", "--quiet").code == 0


@pytest.mark.parametrize(
    ("game", "more"), [("pettingzoo:trap:make", ""), ("toy-pursuit", "plugins: [trap.py], ")]
)
def test_a_game_or_a_plugin_in_a_file_does_not_run(apil: Apil, tmp_path: Path, game: str, more: str) -> None:
    (tmp_path / "trap.py").write_text("import pathlib\npathlib.Path('sprung').touch()\n")
    (tmp_path / "some.yaml").write_text(f"{{env: '{game}', {more}trust: true}}")
    (tmp_path / "matrix.yaml").write_text(
        f"{{methods: [adrl], games: ['{game}'], config: {{{more}trust: true}}}}"
    )
    for flags in (
        ("run", "--config", "some.yaml", "--out", "r"),
        ("bench", "run", "matrix.yaml", "--dry-run"),
        ("bench", "run", "matrix.yaml"),
    ):
        done = apil(*flags)
        assert (done.code, done.err.count("\n"), "or add --trust" in done.err) == (2, 1, True), done.err
    assert apil("config", "show", "--config", "some.yaml").code == (2 if more else 0)
    assert not (tmp_path / "sprung").exists()


def test_the_victims_of_a_matrix_do_not_run(apil: Apil, tmp_path: Path, agent: str) -> None:
    (tmp_path / "matrix.yaml").write_text(
        f"methods: [adrl]\ngames: [toy-pursuit]\nvictims: {{toy-pursuit: ['{agent}']}}\nsteps: 1000\n"
        "config: {trust: true, num_envs: 4}\n"
    )
    done = apil("bench", "run", "matrix.yaml", "--dry-run")
    assert (done.code, "matrix.yaml names it" in done.err) == (2, True)
    assert "an_agent" not in sys.modules
    assert apil("bench", "run", "matrix.yaml", "--dry-run", "--trust", "--quiet").code == 0
    assert "an_agent" in sys.modules


def test_a_mistake_in_the_users_code(
    apil: Apil, agent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = agent.replace("flee", "broken")
    done = apil("eval", broken, *TOY, "--quiet")
    assert done.code == 2
    assert done.err == (
        f"apil: {broken} failed: KeyError: 'no such thing' (APIL_DEBUG=1 shows the traceback)\n"
    )
    monkeypatch.setenv("APIL_DEBUG", "1")
    told = apil("eval", broken, *TOY, "--quiet")
    assert told.code == 2
    assert "an_agent.py" in told.err
    assert "Traceback" in told.err


def test_a_run_is_exported_and_plays_again(apil: Apil, tmp_path: Path) -> None:
    assert apil("run", *SHORT, "--out", "r").code == 0
    done = apil("export", "r", "--format", "onnx", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["file"] == str(tmp_path / "r" / "adversary.onnx")
    assert told["reads"] == ["observation"]
    assert told["difference"] <= 1e-5
    shown = apil("export", "r", "--format", "torchscript", "--out", "mine.pt")
    assert f"load it as torchscript:{tmp_path}/mine.pt" in shown.out
    again = ("export", "r", "--format", "torchscript", "--out", "mine.pt")
    assert "mine.pt exists already; choose another --out, or --force to replace it" in apil(*again).err
    assert apil(*again, "--force").code == 0
    scores = [
        json.loads(apil("eval", *who, "--episodes", "30", "--quiet", "--json").out)
        for who in (("run:r",), ("r",), (told["name"], *TOY), (f"torchscript:{tmp_path}/mine.pt", *TOY))
    ]
    assert len({tuple(score[key] for key in ("wins", "ties", "losses")) for score in scores}) == 1
    wrong = apil("export", "nowhere", "--format", "onnx")
    assert (wrong.code, wrong.err.count("\n")) == (2, 1)
    assert "nowhere is no run directory" in wrong.err
