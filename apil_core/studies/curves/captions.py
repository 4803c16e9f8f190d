"""Titles and captions of figures of learning curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from apil_core.api.profiles import FAITHFUL
from apil_core.studies.curves.groups import CurveGroup
from apil_core.training.episode_stats import WINDOW


@dataclass(frozen=True)
class Wording:
    """The texts of a figure, made from its groups.

    Attributes:
        title: the settings they share.
        explanation: of the figure, in lines.
        player: the side whose shares of games are drawn.
    """

    title: str
    explanation: str
    player: str = "the adversary"

    @classmethod
    def of_runs(cls, groups: Sequence[CurveGroup]) -> Wording:
        """Make the texts where each group is one attack."""
        return cls(title(groups), explanation(groups))


def legend(group: CurveGroup) -> str:
    """Legend label of a group, with the number of seeds if it has several."""
    count = len(group.curves)
    return group.label if count == 1 else f"{group.label}, {count} seeds"


def title(groups: Sequence[CurveGroup]) -> str:
    """Settings that all groups share; the others are in the legend."""
    curves = [curve for group in groups for curve in group.curves]
    methods, games, victims = (
        list(dict.fromkeys(getattr(curve, key) for curve in curves)) for key in ("method", "env", "victim")
    )
    text = methods[0] if len(methods) == 1 else "Attacks"
    if len(victims) == 1:
        text += f" against {victims[0]}"
    if len(games) == 1:
        text += f" in {games[0]}"
    physics = {curve.physics for curve in curves}
    if len(physics) == 1 and not physics & {None, FAITHFUL}:
        text += f", {physics.pop()} physics"
    return text


def explanation(groups: Sequence[CurveGroup]) -> str:
    """Explanation of the figure, and the settings behind its numbers."""
    curves = [curve for group in groups for curve in group.curves]
    budgets = sorted({curve.steps for curve in curves})
    seeds = sorted({curve.seed for curve in curves})
    facts = f"{_span(budgets)} steps, {'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}."
    lines = [f"{facts} Lines: the last {WINDOW} training games (fewer at first)."]
    lines.append(f"Bands: {', '.join(bands(groups))}.")
    games = sorted({point.episodes for curve in curves for point in curve.scores})
    if games:
        lines.append(f"Points: evaluations of {_span(games)} games each, with 95 % intervals.")
    return "\n".join(lines)


def _span(numbers: Sequence[int]) -> str:
    """The single number, or the least and the largest; sorted."""
    ends = dict.fromkeys((numbers[0], numbers[-1]))
    return " to ".join(f"{number:,}" for number in ends)


def bands(groups: Sequence[CurveGroup]) -> Iterator[str]:
    """Meaning of the bands around lines."""
    if any(len(group.curves) == 1 for group in groups):
        yield "95 % intervals of the shares"
    if any(len(group.curves) > 1 for group in groups):
        yield "mean (thick line) ± standard deviation over seeds (thin lines)"
