"""Benchmarks on real Ray clusters, whose workers and nodes are killed under them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import psutil
import pytest

from apil_core import ApilError
from apil_core.common.extras import install_command
from apil_core.studies.bench.jobs import JobStatus, make_jobs
from apil_core.studies.bench.ray_cluster import connect, slots
from apil_core.studies.bench.ray_executor import RayExecutor, _work
from apil_core.studies.bench.schedule import BenchResult, run_jobs
from bench.small_matrix import made, outcome, process_of, rows_of, small_matrix, undisturbed, until

pytest.importorskip("ray", reason="Ray is not installed (pip install -e '.[ray]')")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")

TWO = small_matrix(methods=["adrl", "apl"], steps=40 * 512)
FIRST, SECOND = "cells/toy-pursuit/adrl/s0", "cells/toy-pursuit/apl/s0"


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Two nodes of one CPU, beside a head that works not, started as in the background: deaf to Ctrl-C."""
    import ray
    from ray.cluster_utils import Cluster

    hearing = signal.signal(signal.SIGINT, signal.SIG_IGN)
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    try:
        for _ in range(2):
            made.add_node(num_cpus=1)
        signal.signal(signal.SIGINT, hearing)
        yield made
    finally:
        ray.shutdown()
        made.shutdown()


def go(
    status: JobStatus, address: str | None, meanwhile: Callable[[], None], workers: int | None = None
) -> BenchResult:
    thread = threading.Thread(target=meanwhile)
    with closing(RayExecutor(status.bench.path, workers, 1, address)) as executor:
        thread.start()
        course = run_jobs(make_jobs(status.benchmark), status, executor)
    thread.join()
    return course


@pytest.mark.slow
def test_two_cells_on_a_cluster_of_this_machine(tmp_path: Path):
    """By the command line, whose JSON nothing of Ray's may spoil."""
    matrix = small_matrix(methods=["adrl", "apl"], steps=2 * 512)
    path, root = tmp_path / "m.yaml", tmp_path / "b"
    path.write_text(json.dumps(matrix.model_dump(mode="json")))
    command = [sys.executable, "-m", "apil_core.cli", "bench", "run", str(path), "--out", str(root)]
    done = subprocess.run(
        [*command, "--executor", "ray", "--workers", "1", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert set(json.loads(done.stdout)["jobs"].values()) == {"done"}
    assert [line for line in done.stderr.splitlines() if "done" not in line] == []


@pytest.mark.slow
def test_a_killed_worker_is_replaced_and_nothing_is_run_twice(
    tmp_path: Path, cluster: Any, capsys: pytest.CaptureFixture[str]
):
    status = made(tmp_path / "b", TWO)
    killed: list[int] = []

    def kill() -> None:
        until(lambda: rows_of(status, FIRST) >= 3)
        worker = process_of(status, FIRST).parent()
        assert worker is not None
        assert worker.name().startswith("ray::")
        worker.kill()
        killed.append(worker.pid)

    course = go(status, cluster.address, kill)
    assert course.states == {FIRST: "done", SECOND: "done"}
    assert len(killed) == 1
    assert capsys.readouterr().out == ""  # stdout is for --json; Ray says there that a worker was lost
    sessions = status.bench.cell(FIRST.partition("/")[2])._read_json(
        status.bench.cell(FIRST.partition("/")[2]).environment_path
    )
    assert len(sessions) == 2
    assert outcome(status) == outcome(undisturbed(tmp_path / "whole", TWO))


@pytest.mark.slow
def test_a_lost_node_likewise(tmp_path: Path, cluster: Any):
    status = made(tmp_path / "b", TWO)

    def lose() -> None:
        until(lambda: rows_of(status, FIRST) >= 3)
        worker = process_of(status, FIRST).parent()
        assert worker is not None
        raylets = {p.process.pid: n for n in cluster.worker_nodes for p in n.all_processes["raylet"]}
        cluster.remove_node(raylets[worker.ppid()], allow_graceful=False)

    course = go(status, cluster.address, lose)
    assert course.states == {FIRST: "done", SECOND: "done"}
    assert len(cluster.worker_nodes) == 1
    assert outcome(status) == outcome(undisturbed(tmp_path / "whole", TWO))


@pytest.mark.slow
@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_stops_with_checkpoints_and_twice_at_once(tmp_path: Path, cluster: Any, presses: int):
    steps = 4000 * 512
    status = made(tmp_path / "b", small_matrix(methods=["adrl", "apl"], steps=steps))
    jobs = [job.name for job in make_jobs(status.benchmark)]
    processes: list[psutil.Process] = []

    def press() -> None:
        until(lambda: all(rows_of(status, job) >= 2 for job in jobs))
        processes.extend(process_of(status, job) for job in jobs)
        if presses == 2:  # as if they did not listen: nothing but a kill ends them
            for process in processes:
                process.suspend()
        for _ in range(presses):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(2.0)  # two signals at once are one

    course = go(status, cluster.address, press)
    assert course.interrupted
    assert set(course.states.values()) == {"interrupted"}
    assert not any(process.is_running() for process in processes)
    for job in jobs:
        run = status.bench.cell(job.partition("/")[2])
        assert run.newest_checkpoint().is_file()
        if presses == 1:
            assert run.summary()["status"] == "interrupted"
            assert run.newest_checkpoint() == run.checkpoint_path(rows_of(status, job))


@pytest.mark.slow
def test_jobs_that_fit_on_no_node_are_not_waited_for(cluster: Any, tmp_path: Path):
    import ray

    connect(cluster.address, None)
    assert slots(ray, 1) == 2  # two nodes of one CPU: two jobs of one, but none of two
    with pytest.raises(ApilError, match="--threads 2: no node of the Ray cluster has as many CPUs"):
        slots(ray, 2)


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("127.0.0.1:9", "--address 127.0.0.1:9: no Ray cluster there: .*refused"),
        ("ray-head", "--address ray-head: expected auto or HOST:PORT"),
    ],
)
def test_no_cluster_there_is_told_quickly(tmp_path: Path, address: str, told: str):
    begin = time.monotonic()
    with pytest.raises(ApilError, match=told) as caught:
        RayExecutor(tmp_path, None, 1, address)
    assert time.monotonic() - begin < 30
    assert "\n" not in str(caught.value)


def test_no_ray_is_told_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ApilError, match=re.escape(f"Ray clusters need ray: {install_command('ray')}")):
        RayExecutor(tmp_path, None, 1, None)


def test_a_worker_that_does_not_see_the_benchmark_says_so(tmp_path: Path):
    with pytest.raises(ApilError, match="sees no benchmark in .*nowhere: is that a shared file system"):
        _work(str(tmp_path / "nowhere"), FIRST, 1, "/")
    assert not (tmp_path / "nowhere").exists()
