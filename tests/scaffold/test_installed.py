"""The packages installed into a fresh environment, tested and run there: `make test-templates`."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from apil_core.plugins.scaffold.package import Written
from scaffold.packages import KINDS, write_all

pytestmark = pytest.mark.slow

RUN_ALL = """
import sys
from pathlib import Path
from apil_core.cli import main
for config in map(Path, sys.argv[1:]):  # in one process: most of a small run's time is its start
    out = f"run-{config.parent.name}"
    small = ["--steps", "2k", "--set", "evaluation.episodes=20", "--threads", "1", "--quiet", "--out", out]
    try:
        main(["run", "--config", str(config), *small])
    except SystemExit as end:
        if end.code:
            raise
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[str, Written]:
    return write_all("fresh", tmp_path_factory.mktemp("packages"))


@pytest.fixture(scope="module")
def place(written, tmp_path_factory) -> Path:
    """An empty directory beside an environment of its own, which borrows what is here: torch is big."""
    base = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(base / "venv")], check=True)
    (site,) = (base / "venv").glob("lib/python*/site-packages")
    # addsitedir, and not the bare path: an editable apil is itself a line in a .pth file there
    (site / "borrowed.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
    (base / "work").mkdir()
    packages = [str(made.directory) for made in written.values()]
    done = python(base / "work", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", *packages)
    assert done.returncode == 0, done.stderr
    return base / "work"


def python(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """``python -m ARGUMENTS`` of the fresh environment."""
    environment = {**os.environ, "APIL_CACHE": str(place / "cache"), "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    environment.pop("PYTHONPATH", None)
    command = [str(place.parent / "venv" / "bin" / "python"), "-m", *arguments]
    return subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)


def test_apil_takes_the_installed_packages(place, written):
    done = python(place, "apil_core.cli", "plugins", "--check")
    lines = [line for line in (done.stdout + done.stderr).splitlines() if "fresh" in line]
    for kind in KINDS:
        assert any(written[kind].names.identifier in line for line in lines), done.stdout + done.stderr
    assert done.returncode == 0, done.stdout + done.stderr
    sites = place.parent / "venv"
    for made in written.values():
        (package,) = sites.glob(f"lib/python*/site-packages/{made.names.package}")
        assert (package / "py.typed").is_file()


def test_their_own_tests_pass(place, written):
    folders = [str(made.directory) for made in written.values()]
    done = python(place, "pytest", "-q", "-p", "no:cacheprovider", *folders)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "7 passed" in done.stdout


def test_their_configurations_run(place, written):
    (place / "run_all.py").write_text(RUN_ALL)
    done = python(place, "run_all", *(str(made.directory / "config.yaml") for made in written.values()))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(", 20 games\n") == len(KINDS)
    for made in written.values():
        assert (place / f"run-{made.directory.name}" / "result.json").is_file()
