"""Long-run test: record speed, memory and file sizes of a training, and extrapolate to a whole run.

    python benchmarks/soak.py --out /tmp/soak --game '{"physics": "fast"}' --json soak.json

It is a real run: run directory, recorders, checkpoints. The directory is kept. The exit code is 1 if
memory grows.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from apil_core import RunConfig, run
from apil_core.api.config import EvaluationConfig, PPOConfig
from apil_core.common.errors import ApilError, ConfigError
from apil_core.evaluation.progress import Progress
from apil_core.training.storage.environment import environment
from apil_core.training.storage.run_dir import RunDir

MILLION = 1_000_000
WHOLE_RUN = 35 * MILLION
"""Environment steps of the paper's runs."""

LEAST_POINTS = 10
"""Iterations after the warm-up that a trend needs."""


@dataclass(frozen=True)
class Point:
    """Measurements after an iteration.

    Attributes:
        steps: environment steps so far.
        seconds: of iterations so far.
        memory_mb: resident set of the process.
        log_bytes: of metrics.jsonl and TensorBoard's files.
        checkpoint_bytes: of the checkpoints that are kept.
    """

    steps: int
    seconds: float
    memory_mb: float
    log_bytes: int
    checkpoint_bytes: int


class Watcher(Progress):
    """Records a point after every iteration, and prints one line for each."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self._run_dir = RunDir(".")

    def started(self, config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> None:
        self._run_dir = RunDir(run_dir)
        _tell(f"{config.method} on {config.env} against {victim}, in {run_dir}")

    def iteration(self, metrics: dict[str, float]) -> None:
        here = self._run_dir
        point = Point(
            steps=int(metrics["steps"]),
            seconds=metrics["wall_seconds"],
            memory_mb=metrics["memory_mb"],
            log_bytes=_size(here.metrics_path) + _size(here.path / "tensorboard"),
            checkpoint_bytes=_size(here.checkpoint_dir),
        )
        self.points.append(point)
        _tell(f"{point.steps:12,} steps {metrics['steps_per_second']:8.0f}/s {point.memory_mb:8.1f} MB")


def _size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


@dataclass(frozen=True)
class Trend:
    """Growth per million steps, with a 95 % interval."""

    slope: float
    low: float
    high: float


def trend(steps: Sequence[float], values: Sequence[float]) -> Trend:
    """Fit by least squares, with the interval of Newey and West for autocorrelated errors.

    Memory grows in jumps, so errors are taken as correlated over a tenth of the points.
    """
    from statsmodels.api import OLS, add_constant

    x = add_constant(np.asarray(steps, float) / MILLION)
    lags = max(len(steps) // 10, 1)
    fit = OLS(np.asarray(values, float), x).fit(cov_type="HAC", cov_kwds={"maxlags": lags}, use_t=True)
    low, high = fit.conf_int()[1]
    return Trend(float(fit.params[1]), float(low), float(high))


@dataclass(frozen=True)
class Report:
    """Summary of the points; rates and trends exclude the warm-up.

    Attributes:
        steps: of the run.
        steps_per_second: on average.
        tenths: steps per second of ten parts of the run.
        hours: that a whole run would take.
        memory_mb: at the end.
        memory_trend: MB per million steps.
        growth_mb: of the memory up to a whole run's end, at the trend's upper end.
        log_trend: bytes per million steps.
        checkpoint_mb: most that the kept checkpoints took.
        disk_mb: logs and checkpoints of a whole run.
    """

    steps: int
    steps_per_second: float
    tenths: list[float]
    hours: float
    memory_mb: float
    memory_trend: Trend
    growth_mb: float
    log_trend: Trend
    checkpoint_mb: float
    disk_mb: float


def report(points: Sequence[Point], warm_up: float) -> Report:
    """Make the summary.

    Args:
        points: of all iterations.
        warm_up: share of the steps that is left out.

    Raises:
        ConfigError: too few iterations.
    """
    last = points[-1]
    late = [point for point in points if point.steps >= warm_up * last.steps]
    if len(late) < LEAST_POINTS:
        raise ConfigError(f"{len(late)} iterations after the warm-up; a trend needs {LEAST_POINTS}")
    steps = [point.steps for point in late]
    memory = trend(steps, [point.memory_mb for point in late])
    logs = trend(steps, [point.log_bytes for point in late])
    rate = _rate(late[0], last)
    checkpoint_mb = max(point.checkpoint_bytes for point in points) / MILLION
    return Report(
        steps=last.steps,
        steps_per_second=rate,
        tenths=[_rate(a, b) for a, b in pairwise(_marks(late))],
        hours=WHOLE_RUN / rate / 3600,
        memory_mb=last.memory_mb,
        memory_trend=memory,
        growth_mb=max(memory.high, 0.0) * max(WHOLE_RUN - last.steps, 0) / MILLION,
        log_trend=logs,
        checkpoint_mb=checkpoint_mb,
        disk_mb=logs.slope * WHOLE_RUN / MILLION**2 + checkpoint_mb,
    )


def _rate(begin: Point, end: Point) -> float:
    return (end.steps - begin.steps) / (end.seconds - begin.seconds)


def _marks(points: Sequence[Point]) -> list[Point]:
    """End indices of up to ten parts with about as many points each."""
    count = min(10, len(points) - 1)
    return [points[i * (len(points) - 1) // count] for i in range(count + 1)]


def verdict(result: Report, allowed_mb: float) -> str:
    """Format for the terminal; memory is called flat if a whole run would not add ``allowed_mb`` to it."""
    memory = result.memory_trend
    flat = "flat" if result.growth_mb <= allowed_mb else "IT GROWS"
    slow, fast = min(result.tenths), max(result.tenths)
    return (
        f"speed   {result.steps_per_second:.0f} steps/s (tenths of the run: {slow:.0f} to {fast:.0f}); "
        f"35 M steps take {result.hours:.1f} h\n"
        f"memory  {result.memory_mb:.0f} MB; {memory.slope:+.2f} MB per million steps "
        f"[{memory.low:+.2f}, {memory.high:+.2f}], by 35 M at most {result.growth_mb:.0f} MB more: {flat}\n"
        f"disk    logs {result.log_trend.slope / MILLION:.2f} MB per million steps, checkpoints "
        f"{result.checkpoint_mb:.1f} MB; 35 M steps leave {result.disk_mb:.0f} MB"
    )


def main() -> None:
    arguments = _parser().parse_args()
    watcher = Watcher()
    try:
        run(_config(arguments), out=arguments.out, progress=watcher, command=sys.argv)
        result = report(watcher.points, arguments.warm_up)
    except ApilError as error:
        sys.exit(f"soak.py: {error}")
    print(verdict(result, arguments.allowed_mb))
    if arguments.json:
        points = [asdict(point) for point in watcher.points]
        content = {"environment": environment(sys.argv), **asdict(result), "points": points}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n")
    sys.exit(int(result.growth_mb > arguments.allowed_mb))


def _config(arguments: argparse.Namespace) -> RunConfig:
    """A default run, changed by the arguments; without evaluation, whose games are no training."""
    ppo = {"num_steps": arguments.num_steps} if arguments.num_steps else {}
    return RunConfig(
        method=arguments.method,
        env=arguments.env,
        game=arguments.game,
        steps=arguments.steps,
        seed=arguments.seed,
        **({"num_envs": arguments.num_envs} if arguments.num_envs else {}),
        ppo=PPOConfig(**ppo),
        evaluation=EvaluationConfig(episodes=0),
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, help="run directory; new, and kept")
    add("--steps", type=int, default=2 * MILLION)
    add("--method", default="e_apil")
    add("--env", default="kick-and-defend", help="game")
    add("--game", type=json.loads, default={}, metavar="JSON", help="options of the game")
    add("--num-envs", type=int, help="games at once; default: as a run's")
    add("--num-steps", type=int, help="steps of each in an iteration; default: as a run's")
    add("--seed", type=int, default=0)
    add("--warm-up", type=float, default=0.2, help="share of the steps left out of trends")
    add("--allowed-mb", type=float, default=200, help="growth of memory over 35 M steps that counts as none")
    add("--json", type=Path, metavar="FILE", help="write report and points there")
    return parser


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
