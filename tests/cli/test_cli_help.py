"""Help imports little, is complete and true."""

from __future__ import annotations

import subprocess
import sys

import pytest

from apil_core import __version__
from apil_core.api.config import RunConfig
from cli.cli_helpers import COIN, VERBS, Apil

FLAGS = """
method env victim steps num-envs threads seed preset config set plugin out device quiet json seeds init-from
"""

LIGHT = """
import sys
from apil_core.cli import main
for command in sys.argv[1:]:
    try:
        main(command.split())
    except SystemExit as end:
        assert end.code in (0, 1), end.code
    for name in ("torch", "mujoco", "statsmodels", "tensordict"):
        assert name not in sys.modules, f"apil {command} imports {name}"
"""

LOOKING_AROUND = (
    *("--help", "--version", "run --help", "eval --help", "fidelity --help", "play --help", "export --help"),
    *("retrain --help", "victims check --help", "bench run --help", "new victim --help"),
    *("config diff paper apil-code", f"config show --method e_apil --env coin --plugin {COIN}"),
    *("config schema", "plugins", "methods", "games", "completion bash"),
)


def test_looking_around_imports_nothing_heavy() -> None:
    subprocess.run([sys.executable, "-c", LIGHT, *LOOKING_AROUND], stdout=subprocess.DEVNULL, check=True)


def test_help_lists_every_verb(apil: Apil) -> None:
    text = apil("--help").out
    for verb in VERBS:
        assert f"│ {verb} " in text


def test_run_help_shows_every_flag_with_the_codes_defaults(apil: Apil) -> None:
    text = " ".join(apil("run", "--help").out.replace("│", " ").split())
    for flag in FLAGS.split():
        assert f"--{flag} " in text
    for name in ("method", "env", "steps", "num_envs", "seed", "device"):
        assert f"[default: {RunConfig.model_fields[name].default}]" in text


@pytest.mark.parametrize(
    "verb",
    [
        *("resume", "eval", "play", "fidelity", "runs", "runs compare", "victims import", "config diff"),
        *("doctor", "bench", "bench run", "bench report"),
        *("retrain", "crossplay", "analyze", "analyze activations", "tune"),
        *("new", "new method", "new game", "new victim"),
    ],
)
def test_every_verb_has_help(apil: Apil, verb: str) -> None:
    done = apil(*verb.split(), "--help")
    assert done.code == 0
    assert done.out.startswith(f"Usage: apil {verb}")


def test_version(apil: Apil) -> None:
    assert apil("--version").out.strip() == __version__
