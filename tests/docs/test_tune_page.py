"""docs/tune.md: its space is one, its block of Python runs and passes mypy --strict."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from apil_core import RunConfig
from apil_core.plugins.registry import default_plugins
from apil_core.studies.tune.space import Space
from docs.pages import ROOT, blocks

PAGE = ROOT / "docs" / "tune.md"


def of_language(name):
    (text,) = (block.text for block in blocks(PAGE) if block.language == name)
    return text


def test_the_space_of_the_page(tmp_path):
    file = tmp_path / "space.yaml"
    file.write_text(of_language("yaml"))
    space = Space(file, RunConfig.load("efficient", method="e_apil", env="toy-pursuit"), default_plugins())
    assert len(space.parts) == 5
    assert space.default()["ppo.hidden"] == "[64, 64]"


@pytest.mark.slow
def test_the_session_of_the_page(tmp_path):
    pytest.importorskip("optuna")
    pytest.importorskip("pandas", exc_type=ImportError)
    script = tmp_path / "session.py"
    script.write_text(of_language("python"))
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ended = [line for line in done.stdout.splitlines() if line.startswith("trial ")]
    assert len(ended) == 10
    environment = {**os.environ, "MYPYPATH": ":".join([str(ROOT), str(ROOT / "envs")])}
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", str(script)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
