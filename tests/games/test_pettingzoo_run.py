"""Runs on PettingZoo environments of others: methods, resume, signals, the command line, the example."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from helpers.small_runs import differences, final_state, small_config

from apil_core import ConfigError, PluginError, UnknownNameError, evaluate, resume, run
from apil_core.api.config import BlindMode
from apil_core.cli import main
from apil_core.config.resolve import complete, dump_yaml
from apil_core.config.schema import json_schema
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.training.storage.run_dir import RunDir

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "simple_push" / "simple_push.py"
PUSH = "pettingzoo:mpe2.simple_push_v3:parallel_env"
RACE = {"env": "pettingzoo:games.odd_envs:Race", "victim": "baseline:random/5x2", "num_envs": 6}
FAILING = {"plan": {40: {"raise": "kaputt"}}}


def short(method: str = "adrl", **changes: Any) -> Any:
    return small_config(method, **{**RACE, "steps": 4 * 96, "threads": 2, **changes})


@pytest.fixture(scope="module")
def registry() -> PluginRegistry:
    return discover()


@pytest.mark.parametrize("mode", ["zeros", "initial"])
def test_a_run_is_a_victim_whatever_is_blinded(mode: BlindMode, tmp_path: Path) -> None:
    """What channels tell about the opponent is no matter of who fits the seat."""
    run(short(victim="baseline:random/4x3", victim_side=1, evaluation={"episodes": 0}), out=tmp_path / "cart")
    channels = {"opponent_channels": {"hare": [0], "cart": [1]}}
    options = {"victim": f"run:{tmp_path / 'cart'}", "game_options": channels, "episodes": 6, "threads": 1}
    score = evaluate("random", env=RACE["env"], blind=mode, blind_victim=mode, **options)
    assert (score.episodes, score.victim_side, score.blind, score.blind_victim) == (6, "cart", mode, mode)


def test_a_run_with_action_masks_resumes_bit_for_bit(tmp_path: Path) -> None:
    masked = {"env": "pettingzoo:games.odd_envs:Masked", "victim": "random"}
    run(short(**masked), out=tmp_path / "whole")
    run(short(**masked, steps=2 * 96), out=tmp_path / "parts")
    resume(tmp_path / "parts", steps=4 * 96)
    assert differences(final_state(tmp_path / "whole"), final_state(tmp_path / "parts")) == []


# --- names


def test_a_game_without_a_victim_says_what_to_type(tmp_path: Path) -> None:
    expected = (
        r"has no default victim; name one for its cart \(5 observations, 2 actions\) with --victim NAME, "
        "or try `--victim zero` .* or `--victim random` "
    )
    with pytest.raises(ConfigError, match=expected):
        run(short(victim="auto"), out=tmp_path)
    with pytest.raises(ConfigError, match=r"its hare \(4 observations, 3 actions\)"):
        run(short(victim="auto", victim_side=1), out=tmp_path)


def test_every_name_of_the_family_is_a_game(registry: PluginRegistry) -> None:
    spec = registry.game("pettingzoo:a.b:c")
    assert (spec.name, spec.target, spec.family) == ("pettingzoo:a.b:c", "a.b:c", False)
    assert registry.has_game("pettingzoo:a.b:c")


@pytest.mark.parametrize("name", ["pettingzoo", "pettingzoo:", "toy-pursuit:x", "pettingzo:a:b"])
def test_the_familys_name_alone_is_none(registry: PluginRegistry, name: str) -> None:
    assert not registry.has_game(name)
    with pytest.raises(UnknownNameError, match="pettingzoo:…"):
        registry.game(name)


def test_a_name_of_its_own_goes_before_the_family() -> None:
    ours = discover([EXAMPLE])
    assert (ours.game(PUSH).victim_side, ours.game(PUSH).default_victim) == (1, "simple-push:runner/v1")
    assert ours.game("pettingzoo:mpe2.simple_push_v3:raw_env").victim_side == 0


def test_the_schema_takes_names_and_families(registry: PluginRegistry) -> None:
    listed, pattern = json_schema(registry)["properties"]["env"]["anyOf"]
    assert "toy-pursuit" in listed["enum"]
    assert "pettingzoo" not in listed["enum"]
    assert re.search(pattern["pattern"], "pettingzoo:a:b")
    assert not re.search(pattern["pattern"], "pettingzoo:")


def test_a_config_holds_all_options_and_explains_them(registry: PluginRegistry) -> None:
    config = complete(short(game={"kwargs": {"length": 9}}), registry)
    expected = {"kwargs": {"length": 9}, "max_steps": 1000, "winner": "reward", "opponent_channels": {}}
    assert config.game == expected
    assert "# Winner: " in dump_yaml(config, registry)
    with pytest.raises(ConfigError, match=r"game\.maxsteps: unknown key \(did you mean 'max_steps'"):
        complete(short(game={"maxsteps": 9}), registry)


# --- runs


@pytest.mark.parametrize("method", ["adrl", "e_apil"])  # which is made of the two others
def test_methods_train_on_it(tmp_path: Path, method: str) -> None:
    result = run(short(method, steps=192, evaluation={"episodes": 6}), out=tmp_path / "r")
    assert result.evaluation is not None
    assert set(result.evaluation.causes) <= {"terminated", "truncated"}


@pytest.mark.parametrize(
    ("method", "options"),
    [("adrl", {}), pytest.param("e_apil", {"apil": {"rollouts": "own"}}, marks=pytest.mark.slow)],
)
def test_extending_equals_running_through(tmp_path: Path, method: str, options: dict[str, Any]) -> None:
    run(short(method, options=options), out=tmp_path / "whole")
    run(short(method, options=options, steps=192, threads=1), out=tmp_path / "parts")
    resume(tmp_path / "parts", steps=384, threads=2)
    assert differences(final_state(tmp_path / "whole"), final_state(tmp_path / "parts")) == []


def test_the_other_side_can_be_attacked(tmp_path: Path) -> None:
    config = short(victim_side=1, victim="baseline:zero/4x3", steps=96)
    run(config, out=tmp_path / "r")
    assert RunDir(tmp_path / "r").config().victim_side == 1


def test_an_exception_in_a_worker_keeps_the_checkpoint(tmp_path: Path) -> None:
    config = short(
        env="pettingzoo:games.odd_envs:Scripted",
        victim="baseline:zero/2x2",
        game={"kwargs": FAILING},
        checkpoint={"every_iterations": 1},
    )
    with pytest.raises(PluginError, match=r"odd_envs:Scripted: step\(\) failed: KeyError: 'kaputt'"):
        run(config, out=tmp_path / "r")
    directory = RunDir(tmp_path / "r")
    assert final_state(directory.path)["iteration"] == 2
    assert "kaputt" in (directory.result() or {})["error"]


# --- signals


def alive(marker: str) -> list[int]:
    """Processes with ``marker`` in their command line; forked workers share their parent's."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            text = file.read_bytes()
        except OSError:
            continue
        if marker.encode() in text:
            found.append(int(file.parent.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="needs /proc")
@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGKILL])
def test_no_worker_outlives_its_run(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C goes to the workers too, which must not stop before the iteration is over."""
    (tmp_path / "config.yaml").write_text(dump_yaml(short(steps=1_000_000)))
    marker = str(tmp_path / "r")
    command = ["run", "--config", str(tmp_path / "config.yaml"), "--out", marker, "--quiet", "--trust"]
    process = subprocess.Popen(
        [sys.executable, "-m", "apil_core.cli", *command],
        env={**os.environ, "PYTHONPATH": str(ROOT / "tests")},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not RunDir(tmp_path / "r").checkpoints() and time.monotonic() < deadline:
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.05)
    assert len(alive(marker)) == 3
    if number == signal.SIGINT:
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    error = process.communicate(timeout=60)[1]
    while alive(marker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert alive(marker) == []
    if number == signal.SIGINT:
        assert "Traceback" not in error
        assert RunDir(tmp_path / "r").result()["status"] == "interrupted"  # type: ignore[index]


# --- the example


def apil(*arguments: object) -> None:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    assert not caught.value.code


def test_the_example_from_the_command_line(tmp_path: Path, capfd: Any) -> None:
    small = ("--num-envs", 8, "--quiet", "--set", "ppo.num_steps=32", "--set", "evaluation.episodes=8")
    plugin = ("--plugin", EXAMPLE)
    out = tmp_path / "r"
    apil("run", "--env", PUSH, *plugin, "--method", "adrl", "--steps", 256, *small, "--out", out, "--json")
    result = json.loads(capfd.readouterr().out)["evaluation"]
    assert (result["adversary_side"], result["victim"]["name"]) == ("adversary_0", "simple-push:runner/v1")
    assert result["causes"] == {"truncated": 8}
    assert result["mean_length"] == 25
    assert {"mpe2", "pettingzoo", "numpy"} <= result["versions"].keys()
    apil("resume", out, "--steps", 512, "--quiet")
    apil("eval", out, "--episodes", 4, "--quiet", *plugin)
    capfd.readouterr()
    apil("eval", "baseline:zero/8x5", "--env", PUSH, *plugin, "--episodes", 4, "--json", "--quiet")
    assert json.loads(capfd.readouterr().out)["episodes"] == 4


def test_the_example_with_continuous_actions(tmp_path: Path) -> None:
    config = small_config(
        env=PUSH,
        plugins=(str(EXAMPLE),),
        num_envs=4,
        steps=64,
        game={"kwargs": {"continuous_actions": True}},
        evaluation={"episodes": 4},
    )
    result = run(config, out=tmp_path / "r")
    assert result.evaluation is not None
    assert result.evaluation.game_options["kwargs"] == {"continuous_actions": True}


def test_the_games_are_listed(capfd: Any) -> None:
    apil("games", "--json", "--plugin", EXAMPLE)
    specs = {spec["name"]: spec for spec in json.loads(capfd.readouterr().out)}
    assert specs["pettingzoo"]["family"]
    assert specs[PUSH]["default_victim"] == "simple-push:runner/v1"
    apil("games")
    assert "pettingzoo:…" in capfd.readouterr().out
