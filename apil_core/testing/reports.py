"""Results of the checks, each with a short plain-text table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class HookCost:
    """Cost of one hook in the recorded run.

    Attributes:
        hook: its name.
        calls: number of calls that reached this method.
        every: ``"step"`` (vectorised), ``"rollout"`` or ``"run"``.
        seconds: processor time of one call, median; sum over the plugins that implement the hook.
    """

    hook: str
    calls: int
    every: str
    seconds: float


@dataclass
class MethodReport:
    """A method that passed every check.

    Attributes:
        name: of the method.
        env: the game it was tried on.
        checked: titles of the checks.
        skipped: checks that could not be made, with reasons.
        hooks: implemented hooks with their cost.
        seconds_per_step: all of its hooks per vectorised step of the watched run, those per rollout included.
        num_envs: games of a vectorised step.
        seconds: processor time of the whole check.
    """

    name: str
    env: str
    checked: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    hooks: list[HookCost] = field(default_factory=list)
    seconds_per_step: float = 0.0
    num_envs: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        lines = [f"method {self.name} on {self.env}: {_kept(self.checked, self.seconds)}"]
        if self.hooks:
            rows = [(c.hook, str(c.calls), f"per {c.every}", f"{1e3 * c.seconds:.3f}") for c in self.hooks]
            lines += _table(("hook", "calls", "", "ms a call"), rows)
            step = f"{1e3 * self.seconds_per_step:.3f} ms per vectorised step of {self.num_envs} games"
            lines.append(f"  all hooks: {step}")
        else:
            lines.append("  fills no hook")
        return "\n".join([*lines, *_skipped(self.skipped)])


@dataclass
class GameReport:
    """A game that passed every check.

    Attributes:
        name: of the game.
        checked: titles of the checks.
        skipped: checks that could not be made, with reasons.
        sides: name, size of observation and of action.
        steps_per_second: of all games together, random actions, one thread.
        endings: how often the games of the check ended how.
        seconds: processor time of the whole check.
    """

    name: str
    checked: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    sides: list[tuple[str, int, int]] = field(default_factory=list)
    steps_per_second: float = 0.0
    endings: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    def __str__(self) -> str:
        lines = [f"game {self.name}: {_kept(self.checked, self.seconds)}"]
        rows = [(name, str(seen), str(done)) for name, seen, done in self.sides]
        lines += _table(("side", "observation", "action"), rows)
        endings = ", ".join(f"{cause} {count}" for cause, count in self.endings.items()) or "none seen"
        lines += [f"  steps per second: {self.steps_per_second:.0f}", f"  endings: {endings}"]
        return "\n".join([*lines, *_skipped(self.skipped)])


@dataclass
class VictimReport:
    """A victim that passed every check.

    Attributes:
        name: by which it can be loaded again.
        env: the game.
        side: name of its seat.
        sha256: of its weights.
        checked: titles of the checks.
        notes: permitted but notable findings.
        wins, ties, losses: the victim's, against the random baseline.
        seconds: processor time of the whole check.
    """

    name: str
    env: str
    side: str = ""
    sha256: str = ""
    checked: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    wins: int = 0
    ties: int = 0
    losses: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        rows = [
            ("seat", self.side),
            ("sha256", self.sha256[:16]),
            ("against random", f"{self.wins} won, {self.ties} tied, {self.losses} lost"),
            *(("note", note) for note in self.notes),
        ]
        head = f"victim {self.name} on {self.env}: {_kept(self.checked, self.seconds)}"
        return "\n".join([head, *_table(("", ""), rows)[1:]])


def _kept(checked: Sequence[str], seconds: float) -> str:
    return f"{len(checked)} checks passed ({seconds:.1f} s)"


def _skipped(skipped: Sequence[str]) -> list[str]:
    return [f"  not checked: {text}" for text in skipped]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Format lines with aligned columns, indented by two spaces."""
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(r, widths, strict=True)) for r in [head, *rows]
    )
    return [f"  {line}".rstrip() for line in lines]
