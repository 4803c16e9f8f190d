"""The built wheel in an environment that has nothing else: `make test-wheel`.

Are all files in it, all dependencies named, and is a library that only an extra brings asked for in one line?
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]
ROOT = Path(__file__).parents[2]
RUN = ("run", "--method", "e_apil", "--env", "toy-pursuit", "--set", "evaluation.episodes=20", "--quiet")


def shell(*command: str, cwd: Path) -> None:
    subprocess.run(command, cwd=cwd, check=True)


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A directory with a finished run, beside the environment."""
    base = tmp_path_factory.mktemp("wheel")
    pip = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    shell(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(base), str(ROOT), cwd=base)
    shell(sys.executable, "-m", "venv", str(base / "env"), cwd=base)
    (wheel,) = base.glob("*.whl")
    python = str(base / "env" / "bin" / "python")
    shell(python, *pip, "-c", str(ROOT / "constraints.txt"), str(wheel), cwd=base)
    (base / "work").mkdir()
    done = apil(base / "work", *RUN, "--steps", "4k", "--out", "run")
    assert done.returncode == 0, done.stderr
    return base / "work"


def apil(place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "APIL_CACHE": str(place / "cache")}
    environment.pop("PYTHONPATH", None)
    command = [str(place.parent / "env" / "bin" / "apil"), *arguments]
    return subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "arguments",
    [
        ("eval", "run", "--episodes", "20"),
        ("resume", "run", "--steps", "30k"),
        ("play", "run", "--snapshots", "3"),
        ("export", "run", "--format", "torchscript"),
        ("crossplay", "--adversaries", "run", "--victims", "auto", "--episodes", "20"),
        ("run", "--method", "adrl", "--env", "sumo-ants", "--steps", "1", "--set", "evaluation.episodes=0"),
        ("runs", "list", "."),
        ("doctor", "--quick"),
        ("new", "method", "my-attack"),
    ],
    ids=" ".join,
)
def test_the_bare_install_is_enough(place, arguments):
    done = apil(place, *arguments)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("play", "run", "--video", "game.mp4"), "videos need PyAV: pip install 'apil[video] @ file:"),
        (
            (*RUN, "--steps", "4k", "--out", "shown", "--show"),
            "need matplotlib: pip install 'apil[report] @ file:",
        ),
        (("runs", "plot", "run"), "need matplotlib: pip install 'apil[report] @ file:"),
        (("tune", "adrl", "--env", "toy-pursuit"), "need optuna: pip install 'apil[tune] @ file:"),
        (("bench", "report", "run"), "need matplotlib: pip install 'apil[report] @ file:"),
        (("analyze", "activations", "run"), "need matplotlib: pip install 'apil[report] @ file:"),
        (("victims", "check", "onnx:no.onnx", "--env", "toy-pursuit"), "pip install 'apil[onnx] @ file:"),
        ((*RUN, "--set", "recorders=[jsonl,wandb]", "--out", "logged"), "pip install 'apil[wandb] @ file:"),
    ],
    ids=lambda case: " ".join(case[:2]) if isinstance(case, tuple) else "",
)
def test_what_only_an_extra_brings_is_asked_for_in_one_line_before_anything_is_done(place, arguments, line):
    done = apil(place, *arguments)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert line in done.stderr
    assert not any(
        (place / name).exists() for name in ("shown", "logged", "game.mp4", "curve.png", "run/report")
    )
