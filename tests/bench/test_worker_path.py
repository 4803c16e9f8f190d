"""Processes started with ``-m`` import nothing from the current folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import apil_core
from apil_core.studies.bench.supervised import SupervisedJob


def test_a_worker_does_not_run_files_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("queue", "random", "apil_core"):
        Path(f"{name}.py").write_text("import pathlib\npathlib.Path('sprung').touch()\n")
    with SupervisedJob(tmp_path / "b", "cells/none", 1) as job:
        assert job.wait() == "failed"
    log = next((tmp_path / "b").rglob("*.log")).read_text()
    assert "is no benchmark" in log, "it got as far as looking for its matrix"
    assert not Path("sprung").exists()


def test_every_child_is_started_like_that() -> None:
    sources = [path.read_text("utf-8") for path in Path(apil_core.__file__).parent.rglob("*.py")]
    children = [found for text in sources for found in re.findall(r'sys\.executable, (.*)"-m"', text)]
    assert children == ['"-P", '] * 3
