"""Completion scripts: valid in their shell, and complete what the command line has."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cli.cli_helpers import VERBS, Apil

PRESS_TAB = """
source "$1"; shift
COMP_WORDS=(apil "$@"); COMP_CWORD=$#; COMPREPLY=()
"$(complete -p apil | sed 's/.*-F \\([^ ]*\\).*/\\1/')"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(apil: Apil, tmp_path: Path) -> Path:
    """The completion script for bash."""
    done = apil("completion", "bash")
    assert (done.code, done.err) == (0, "")
    file = tmp_path / "apil.bash"
    file.write_text(done.out)
    return file


def completed(script: Path, *words: str) -> set[str]:
    """What bash offers when Tab is pressed in the last word."""
    command = ["bash", "--norc", "-c", PRESS_TAB, "bash", str(script), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_valid_in_its_shell(apil: Apil, tmp_path: Path, shell: str) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    file = tmp_path / "script"
    file.write_text(apil("completion", shell).out)
    done = subprocess.run([shell, "-n", str(file)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_names_every_verb(apil: Apil, shell: str) -> None:
    words = set(apil("completion", shell).out.replace("'", " ").replace('"', " ").replace(":", " ").split())
    assert set(VERBS) <= words


def test_tab_completes_verbs_that_are_imported_only_when_called(script: Path) -> None:
    assert set(VERBS) <= completed(script, "")
    assert completed(script, "do") == {"doctor"}
    assert {"list", "import", "download"} <= completed(script, "victims", "")


def test_tab_completes_flags_and_fixed_values(script: Path) -> None:
    assert {"--method", "--env", "--victim", "--steps", "--preset", "--json"} <= completed(
        script, "run", "--"
    )
    assert completed(script, "run", "--vic") == {"--victim"}
    assert {"--game", "--base-url"} <= completed(script, "victims", "download", "--")
    assert completed(script, "eval", "--victim-actions", "") == {"sample", "mode"}
    assert completed(script, "completion", "") == {"bash", "zsh", "fish"}


def test_another_shell_is_a_mistake(apil: Apil) -> None:
    done = apil("completion", "tcsh")
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "bash" in done.err


def test_making_the_script_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom apil_core.cli.app import make_app\nmake_app().generate_completion(shell='bash')\n"
        "print([name for name in ('torch', 'mujoco', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
