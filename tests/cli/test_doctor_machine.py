"""What ``apil doctor`` says of the machine: Python, packages, processor, GPU and disk."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest

from apil_core.cli.doctor_checks import Scope, machine
from apil_core.plugins.discovery import PluginRegistry


@pytest.mark.parametrize(
    ("version", "status"),
    [("3.10.14", "error"), ("3.11.0", "ok"), ("3.13.9", "ok"), ("3.14.0rc1", "warning")],
)
def test_python_is_judged_by_what_the_distribution_asks_for(version: str, status: str) -> None:
    assert machine.judge_python(version, ">=3.11", "/bin/python").status == status


def test_packages_of_reads_versions_extras_and_markers() -> None:
    requirements = [
        "numpy>=2.0",
        "torch>=99",
        "no-such-thing-anywhere>=1",
        "ancient; python_version < '3'",
        "pytest>=8; extra == 'dev'",
    ]
    found = {p.requirement.name: (p.found, p.fits) for p in machine.packages_of(requirements)}
    assert found == {
        "torch": (metadata.version("torch"), False),
        "numpy": (metadata.version("numpy"), True),
        "no-such-thing-anywhere": (None, False),
    }
    assert [p.asked for p in machine.packages_of(requirements, "dev")] == ["pytest>=8"]


def test_the_packages_here_are_those_that_are_needed() -> None:
    findings = list(machine.packages(Scope(PluginRegistry())))
    assert f"torch {metadata.version('torch')}, mujoco {metadata.version('mujoco')}" in findings[0].detail
    assert {finding.status for finding in findings} == {"ok"}
    assert f"pytest {metadata.version('pytest')}" in {f.check: f.detail for f in findings}["extra: dev"]


@pytest.mark.parametrize(
    ("usable", "limit", "status", "remedy"),
    [
        (8, None, "ok", ""),
        (8, 8.0, "ok", ""),
        (8, 2.5, "warning", "--threads 2"),
        (2, 0.5, "warning", "--threads 1"),
    ],
)
def test_a_container_that_gets_less_time_than_cpus(
    usable: int, limit: float | None, status: str, remedy: str
) -> None:
    finding = machine.judge_cpus(8, usable, limit)
    assert (finding.status, finding.remedy) == (status, remedy)


def test_the_tightest_control_group_counts(tmp_path: Path) -> None:
    group, v2, v1 = tmp_path / "cgroup", tmp_path / "v2", tmp_path / "v1"
    (v2 / "box" / "inner").mkdir(parents=True)
    (v1 / "job").mkdir(parents=True)
    group.write_text("3:cpuset:/x\n2:cpu,cpuacct:/job\n0::/box/inner\n")
    assert machine.container_limit(group, v2, v1) is None
    (v2 / "box" / "inner" / "cpu.max").write_text("max 100000\n")
    (v2 / "box" / "cpu.max").write_text("150000 100000\n")
    assert machine.container_limit(group, v2, v1) == 1.5
    (v1 / "job" / "cpu.cfs_quota_us").write_text("-1\n")
    (v1 / "job" / "cpu.cfs_period_us").write_text("100000\n")
    assert machine.container_limit(group, v2, v1) == 1.5
    (v1 / "job" / "cpu.cfs_quota_us").write_text("50000\n")
    assert machine.container_limit(group, v2, v1) == 0.5
    assert machine.container_limit(tmp_path / "none", v2, v1) is None


def test_no_gpu_is_fine_and_one_is_named_with_what_we_know_of_it() -> None:
    assert machine.judge_gpu([]).status == "ok"
    assert machine.judge_gpu([]).remedy == ""
    finding = machine.judge_gpu(["Imaginary 9000"])
    assert "Imaginary 9000" in finding.detail
    assert "never tested" in finding.detail


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    writable = machine.free_space("x", tmp_path / "a" / "b", "error", "move")
    assert writable.status == "ok"
    assert "GiB free" in writable.detail
    assert list(tmp_path.iterdir()) == []
    refused = machine.free_space(
        "x", Path("/proc/apil/runs"), "error", "move"
    )  # not even root may write there
    assert (refused.status, refused.remedy) == ("error", "move")
    assert "/proc/apil/runs cannot be written" in refused.detail
    (tmp_path / "file").touch()
    blocked = machine.free_space("x", tmp_path / "file" / "runs", "warning", "move")
    assert blocked.status == "warning"
    assert f"{tmp_path / 'file'} is a file" in blocked.detail
