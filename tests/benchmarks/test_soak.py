"""What the soak concludes from its points, and that it runs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from apil_core import ConfigError

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def soak(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import soak

    return soak


def points(soak, growth: float, count: int = 100):
    """Two million steps at 1000 a second; memory grows from 500 MB by ``growth`` per million, with noise."""
    noise = np.random.default_rng(0).normal(0, 0.5, count)
    return [
        soak.Point(
            steps=20_000 * i,
            seconds=20.0 * i,
            memory_mb=(300 if i < 5 else 500) + growth * 0.02 * i + noise[i - 1],
            log_bytes=1000 * i,
            checkpoint_bytes=3_000_000,
        )
        for i in range(1, count + 1)
    ]


def test_a_flat_run(soak):
    result = soak.report(points(soak, growth=0), warm_up=0.2)
    assert result.steps_per_second == pytest.approx(1000)
    assert result.tenths == pytest.approx([1000] * 10)
    assert result.hours == pytest.approx(35e6 / 1000 / 3600)
    assert result.memory_trend.low < 0 < result.memory_trend.high
    assert result.log_trend.slope == pytest.approx(50_000)  # 1000 bytes per 20 000 steps
    assert result.disk_mb == pytest.approx(0.05 * 35 + 3)
    assert "flat" in soak.verdict(result, allowed_mb=200)


def test_a_leak_is_seen(soak):
    result = soak.report(points(soak, growth=20), warm_up=0.2)
    assert result.memory_trend.low < 20 < result.memory_trend.high
    assert result.memory_trend.low > 18
    assert result.growth_mb == pytest.approx(33 * result.memory_trend.high)
    assert "IT GROWS" in soak.verdict(result, allowed_mb=200)


def test_too_short_a_run_says_so(soak):
    with pytest.raises(ConfigError, match="4 iterations after the warm-up; a trend needs 10"):
        soak.report(points(soak, growth=0, count=4), warm_up=0.2)


@pytest.mark.slow
def test_it_runs_on_the_toy_game(tmp_path):
    command = [sys.executable, str(FOLDER / "soak.py"), "--out", str(tmp_path / "r"), "--env", "toy-pursuit"]
    command += ["--steps", "2000", "--num-envs", "8", "--num-steps", "16", "--allowed-mb", "1e9"]
    command += ["--json", str(tmp_path / "soak.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "soak.json").read_text())
    assert report["steps"] == 2048
    assert len(report["points"]) == 16
    assert report["checkpoint_mb"] > 0
    assert report["log_trend"]["slope"] > 0
    assert {"speed", "memory", "disk"} <= {line.split()[0] for line in done.stdout.splitlines()}
