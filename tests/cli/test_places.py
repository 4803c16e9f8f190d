"""Places that are full, closed, gone, read-only or impossible: one line, and nothing is lost."""

from __future__ import annotations

import os
import pty
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from apil_core.testing.states import differences
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir
from cli.cli_helpers import COIN, SMALL, TINY, Apil

LONG = "x" * 300
COMMAND = (sys.executable, "-m", "apil_core.cli")


def called(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *words], stderr=subprocess.PIPE, text=True, check=False, **options)


@pytest.mark.parametrize(
    "words",
    [
        ("run", *TINY, "--out", LONG),
        ("run", "--config", LONG),
        ("resume", LONG),
        ("eval", LONG, "--env", "coin", "--plugin", COIN),
        ("runs", "list", LONG),
        ("runs", "compare", LONG, LONG),
        ("bench", "run", LONG),
        ("bench", "report", LONG),
        ("run", *TINY, "--victim", f"onnx:{LONG}"),
    ],
    ids=lambda words: words[0],
)
def test_a_name_that_is_too_long(apil: Apil, words: tuple[str, ...]) -> None:
    done = apil(*words)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "File name too long" in done.err


@contextmanager
def limited(kind: int, limit: int) -> Iterator[None]:
    """This process may have no more than that of something."""
    before = resource.getrlimit(kind)
    resource.setrlimit(kind, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(kind, before)


def test_a_full_disk_keeps_the_last_checkpoint(apil: Apil, tmp_path: Path) -> None:
    out = tmp_path / "r"
    words = ("run", *TINY, *SMALL, "--set", "checkpoint.every_iterations=1", "--method", "adrl", "--quiet")
    with limited(resource.RLIMIT_FSIZE, 20_000):
        full = apil(*words, "--out", out)
    assert full.code == 2
    assert full.err.splitlines()[-1].endswith("File too large; what was there before is untouched")
    assert not list(out.rglob("*.tmp"))


def test_output_that_cannot_be_written(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = called("methods", stdout=full)
    assert (done.returncode, done.stderr) == (2, "apil: No space left on device\n")
    closed = called("methods", preexec_fn=lambda: os.close(1))
    assert (closed.returncode, closed.stderr) == (0, "")
    latin = called("methods", stdout=subprocess.PIPE, env={**os.environ, "PYTHONIOENCODING": "latin-1"})
    assert (latin.returncode, latin.stderr) == (0, "")
    assert "e_apil" in latin.stdout
    gone = called("methods", stdout=subprocess.PIPE, cwd=tmp_path, preexec_fn=tmp_path.rmdir)
    assert (gone.returncode, gone.stdout) == (2, "")
    assert gone.stderr == "apil: the current directory is gone: change to one that is there\n"


def test_a_home_directory_behind_an_equals_sign(
    apil: Apil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    done = apil("run", *TINY, *SMALL, "--method", "adrl", "--out=~/a~b", "--quiet")
    assert done.code == 0, done.err
    assert (tmp_path / "home" / "a~b" / "result.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said", "place"),
    [
        ("os.rename('r', 'moved')", "r was moved to {}/moved during training; from iteration 1: ", "moved"),
        (
            "shutil.rmtree('r')",
            "r was deleted with its log and checkpoints during training; from iteration 1: ",
            "r",
        ),
        (
            "os.unlink('r/metrics.jsonl')",
            "r/metrics.jsonl was deleted during training; its rows until now",
            "r",
        ),
        ("shutil.rmtree('r/checkpoints')", "", "r"),
    ],
    ids=["moved", "deleted", "no log", "no checkpoints"],
)
def test_a_directory_that_changes_during_training(tmp_path: Path, change: str, said: str, place: str) -> None:
    (tmp_path / "change.py").write_text(
        "import os, shutil\nfrom apil_core import hookimpl\n\n\n@hookimpl\ndef iteration_finished(metrics):\n"
        f"    if not os.path.exists('done'):\n        open('done', 'w').close()\n        {change}\n"
    )
    words = ("run", *TINY, *SMALL, "--method", "adrl", "--plugin", "change.py", "--quiet")
    words = (*words, "--set", "observers=[change]", "--set", "recorders=[jsonl]", "--out")
    done = called(*words, "r", cwd=tmp_path, stdout=subprocess.PIPE)
    assert done.returncode == (2 if said else 0)
    assert done.stderr.startswith(f"apil: {said.format(tmp_path)}" if said else "")
    assert done.stderr.count("\n") == bool(said)
    if said:
        again = called("resume", place, "--quiet", "--trust", cwd=tmp_path, stdout=subprocess.PIPE)
        assert again.returncode == 0, again.stderr
    assert called(*words, "whole", cwd=tmp_path, stdout=subprocess.PIPE).returncode == 0
    left, whole = (
        checkpoint.read(RunDir(tmp_path / path).newest_checkpoint())["learner"] for path in (place, "whole")
    )
    assert not differences(left, whole)


@pytest.mark.slow
@pytest.mark.parametrize("ignored", [False, True], ids=["heard", "nohup"])
def test_a_hangup_stops_with_a_checkpoint_unless_it_is_ignored(tmp_path: Path, ignored: bool) -> None:
    handler = signal.SIG_IGN if ignored else signal.SIG_DFL
    out, plugin = tmp_path / "r", tmp_path / "hang.py"
    plugin.write_text(
        "import os, signal\nfrom apil_core import hookimpl\n\n\n@hookimpl\ndef iteration_finished(metrics):\n"
        "    if metrics['iteration'] == 1:\n        os.kill(os.getpid(), signal.SIGHUP)\n"
    )
    words = ("run", *TINY, *SMALL, "--method", "adrl", "--plugin", str(plugin), "--quiet", "--out", str(out))
    done = called(
        *(*words, "--set", "observers=[hang]"),
        preexec_fn=lambda: signal.signal(signal.SIGHUP, handler),
        stdout=subprocess.PIPE,
    )
    assert done.returncode == (0 if ignored else 130), done.stderr
    assert RunDir(out).newest_checkpoint().name == f"iteration-0000000{2 if ignored else 1}.pt"


@pytest.mark.slow
def test_a_terminal_that_closes_stops_with_a_checkpoint(tmp_path: Path) -> None:
    words = ["run", *TINY, *SMALL, "--method", "adrl", "--set", "checkpoint.every_iterations=1", "--out", "r"]
    words[words.index("256")] = "100M"
    child, terminal = pty.fork()
    if not child:
        os.chdir(tmp_path)
        os.execv(sys.executable, [*COMMAND, *words])
    run = RunDir(tmp_path / "r")
    while not run.checkpoints():
        assert os.read(terminal, 10_000)  # raises when the command has ended
    os.close(terminal)  # the kernel sends SIGHUP
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 130
    steps = run.last_metrics()["steps"]
    assert run.result()["status"] == "interrupted"
    assert checkpoint.read(run.newest_checkpoint())["steps"] == steps
    more = called(
        "resume", "r", "--steps", str(int(steps) + 256), "--quiet", cwd=tmp_path, stdout=subprocess.PIPE
    )
    assert more.returncode == 0, more.stderr
    assert run.last_metrics()["steps"] == steps + 256


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("taskset") is None or (os.cpu_count() or 1) < 2, reason="taskset, two CPUs")
def test_one_cpu_gives_the_weights_of_two(tmp_path: Path) -> None:
    words = [
        *COMMAND,
        "run",
        "--method",
        "e_apil",
        "--env",
        "toy-pursuit",
        "--num-envs",
        "64",
        "--steps",
        "8k",
    ]
    words += ["--set", "ppo.num_steps=32", "--set", "evaluation.episodes=0", "--quiet", "--out"]
    for before, out in ((["taskset", "-c", "0"], "one"), ([], "two")):
        subprocess.run([*before, *words, str(tmp_path / out)], check=True, stdout=subprocess.PIPE)
    one, two = (checkpoint.read(RunDir(tmp_path / out).newest_checkpoint()) for out in ("one", "two"))
    assert not differences(one["learner"], two["learner"])
    assert not differences(one["methods"], two["methods"])


def test_memory_that_is_too_small(apil: Apil, tmp_path: Path) -> None:
    words = ("run", "--env", "toy-pursuit", "--num-envs", "20000", "--set", "ppo.num_steps=1000")
    with limited(resource.RLIMIT_AS, psutil.Process().memory_info().vms + 500_000_000):
        small = apil(*words, "--method", "adrl", "--out", "r")
    assert (small.code, small.err.count("\n")) == (2, 1)
    assert small.err.startswith("apil: memory is too small")
    assert not (tmp_path / "r").exists()
