"""docs/python.md: its blocks run as one session, and pass mypy --strict."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from docs.pages import ROOT, blocks

PAGE = ROOT / "docs" / "python.md"


@pytest.fixture
def script(tmp_path):
    file = tmp_path / "session.py"
    file.write_text("\n".join(block.text for block in blocks(PAGE) if block.language == "python"))
    return file


@pytest.mark.slow
def test_the_page_runs_as_one_session(script, tmp_path):
    pytest.importorskip("pandas", exc_type=ImportError)
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "RunConfig.load: ppo.gama: unknown key (did you mean 'gamma'?)"
    assert lines[1].startswith("finished 5")
    assert (tmp_path / "runs/slow/result.json").is_file()


@pytest.mark.slow
def test_the_page_is_typed(script, tmp_path):
    environment = {**os.environ, "MYPYPATH": ":".join([str(ROOT), str(ROOT / "envs")])}
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache")]
    command += ["--follow-imports=silent", "--disable-error-code=unused-ignore", str(script)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
