"""Numbers of a running training as short texts, shared by the live view and the plain lines."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

from apil_core.api.profiles import FAITHFUL

if TYPE_CHECKING:
    from apil_core.evaluation.results import EvaluationResult, MatchSetup, Rate


def percent(rate: Rate) -> str:
    """``31.2 % [28.4, 34.1]``."""
    return f"{100 * rate.value:.1f} % [{100 * rate.low:.1f}, {100 * rate.high:.1f}]"


def share(rate: Rate) -> tuple[str, str]:
    """``31.2 %`` and ``28.4 – 34.1 %``."""
    return f"{100 * rate.value:.1f} %", f"{100 * rate.low:.1f} – {100 * rate.high:.1f} %"


def speed(metrics: Mapping[str, float]) -> str:
    """Steps per second, and the share of each phase in an iteration's time."""
    collect, update = metrics.get("collect_seconds", 0), metrics.get("update_seconds", 0)
    return (
        f"{metrics.get('steps_per_second', 0):,.0f} steps/s, "
        f"per iteration {collect:.1f} s collecting, {update:.1f} s learning"
    )


def outcomes(metrics: Mapping[str, float]) -> dict[str, str]:
    """Win, tie and loss shares of the last games with Wilson 95 % intervals; empty before a game has ended.

    The adversary's, or in a retraining the victim's.
    """
    from apil_core.evaluation.results import wilson

    games = int(metrics.get("window_games", 0))
    if not games:
        return {}
    whose = "victim's " if any(name.startswith("opponent/") for name in metrics) else ""
    keys = {f"{whose}win": "window_wins", "tie": "window_ties", "loss": "window_losses"}
    return {name: percent(wilson(int(metrics[key]), games)) for name, key in keys.items()}


def returns(metrics: Mapping[str, float]) -> str:
    """Mean returns of both sides, in the game's reward, and the mean length of the games that just ended."""
    texts = {
        "adversary": metrics.get("return/adversary"),
        "victim": metrics.get("return/victim"),
        "game length": metrics.get("episode_length"),
    }
    return ", ".join(f"{name} {value:.1f}" for name, value in texts.items() if value is not None)


def imitator(metrics: Mapping[str, float]) -> str:
    """The imitator's error and likelihood and the discriminator's accuracy; empty where none is logged."""
    parts = []
    if "apil/relative_error" in metrics:
        parts.append(f"error {metrics['apil/relative_error']:.2f} of the best constant's")
    if "apil/explained_share" in metrics:
        parts.append(f"explained share {metrics['apil/explained_share']:.0%}")
    own, constant = metrics.get("apil/log_likelihood"), metrics.get("apil/constant_log_likelihood")
    if own is not None and constant is not None:
        parts.append(f"log-likelihood {own:.1f} (constant {constant:.1f})")
    on_victim = metrics.get("apil/discriminator_accuracy_victim")
    on_imitator = metrics.get("apil/discriminator_accuracy_imitator")
    if on_victim is not None and on_imitator is not None:
        parts.append(f"D right on victim {on_victim:.0%}, imitator {on_imitator:.0%}")
    return ", ".join(parts)


def endings(metrics: Mapping[str, float]) -> str:
    """Endings of the games behind :func:`outcomes`, most frequent first."""
    prefix = "window_cause/"
    counts = Counter(
        {name.removeprefix(prefix): int(n) for name, n in metrics.items() if name.startswith(prefix) and n}
    )
    return ", ".join(f"{name} {count / counts.total():.0%}" for name, count in counts.most_common())


def iteration(metrics: Mapping[str, float], left: str) -> list[str]:
    """Parts of one line about an iteration; empty ones are left out."""
    shares, lately = outcomes(metrics), endings(metrics)
    done = f"{metrics['steps']:,.0f} of {metrics['total_steps']:,.0f} steps"
    return [
        f"iteration {metrics['iteration']:.0f}: {done}",
        f"{metrics['steps_per_second']:,.0f} steps/s, {left} left",
        ", ".join(f"{name} {text}" for name, text in shares.items()),
        f"returns: {text}" if (text := returns(metrics)) else "",
        imitator(metrics),
        f"endings: {lately}" if lately else "",
    ]


class Pace:
    """Time left, from the first iteration on: an exponential average with weight 0.1 for each later one."""

    def __init__(self) -> None:
        self._step = 0.0
        self._began: float | None = None

    def left(self, metrics: Mapping[str, float]) -> str:
        """Time left of a training, after an iteration."""
        step = 1 / metrics["steps_per_second"] if metrics["steps_per_second"] else 0.0
        self._step = 0.9 * self._step + 0.1 * step if self._step else step
        return duration(max(metrics["total_steps"] - metrics["steps"], 0) * self._step)

    def games_left(self, done: int, total: int) -> str:
        """Time left of an evaluation, while its games end; ``–`` before the first one has ended."""
        now = time.monotonic()
        self._began = now if self._began is None or not done else self._began
        seconds = (now - self._began) * (total - done) / done if done else 0.0
        if done >= total:
            self._began = None
        return duration(seconds) if done else "–"


def score_line(result: EvaluationResult, steps: int) -> str:
    """Format one evaluation as one line."""
    return (
        f"evaluation after {steps:,} steps, {result.episodes} games{physics(result)}: "
        f"win {percent(result.win_rate)}, tie {percent(result.tie_rate)}, loss {percent(result.loss_rate)}"
    )


def game_name(env: str, physics: str | None) -> str:
    """``sumo-ants, fast``; the game's name alone where its physics is faithful, or has no profiles."""
    return env if physics in (None, FAITHFUL) else f"{env}, {physics}"


def physics(result: MatchSetup) -> str:
    """``, physics fast``; empty where the physics is the game's own, or has no profiles."""
    return "" if result.physics in (None, FAITHFUL) else f", physics {result.physics}"


def duration(seconds: float) -> str:
    """``3:05`` or ``2:03:05``."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
