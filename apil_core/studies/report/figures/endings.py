"""Figures of game endings: the winner, and the rule that ended the game."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from apil_core.studies.report.figures.palette import CAUSES, GROUND, placeholder
from apil_core.studies.report.figures.plot import Plot, listing, short
from apil_core.studies.report.models import Endings
from apil_core.studies.report.words import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEEING = "seeing adversary"
"""Label of unblinded scores."""

_HATCHES = ("", "///", "", "|||", "", "\\\\\\", "", "xxx")
"""Hatches of causes, so that neighbours differ without colour too."""

_OUTCOMES = (
    ("adversary wins", "wins", placeholder("adversary"), ""),
    ("tie", "ties", placeholder("tie"), "///"),
    ("victim wins", "losses", placeholder("victim"), ""),
)
_LETTERS = 62  # of a legend's font that fit side by side


class Part(NamedTuple):
    """One segment of every bar: name, counts for each column, colour and pattern."""

    name: str
    counts: Sequence[int]
    colour: str
    hatch: str


def ending_bars(
    endings: Sequence[Endings], scores: Mapping[str, str], settings: Mapping[str, str]
) -> list[Plot]:
    """Make two figures for each game of a table: by outcome and by cause, a bar for each column.

    Args:
        endings: those without games are left out.
        scores: the adversary's observation, by table, e.g. ``"blinded: zeros"``.
        settings: labels by id, where there are several.
    """
    groups: dict[tuple[str, str], list[Endings]] = {}
    causes: dict[str, Counter[str]] = {}
    for ending in endings:
        if ending.episodes:
            groups.setdefault((ending.table, ending.game), []).append(ending)
            causes.setdefault(ending.game, Counter()).update(ending.causes)
    plots = []
    for (table, game), group in groups.items():
        words, score = settings.get(group[0].setting, ""), scores.get(table, table)
        outcomes = [Part(name, [getattr(e, key) for e in group], c, h) for name, key, c, h in _OUTCOMES]
        # a cause has one colour in all figures of its game
        counted = _counted(group, [name for name, _ in causes[game].most_common()])
        plots += [
            _bars(group, kind, parts, score, words)
            for kind, parts in (("outcome", outcomes), ("cause", counted))
        ]
    return plots


def _counted(group: Sequence[Endings], causes: Sequence[str]) -> list[Part]:
    return [
        Part(
            name,
            [ending.causes.get(name, 0) for ending in group],
            CAUSES[i % len(CAUSES)],
            # a repeated colour has another pattern
            _HATCHES[(i + i // len(CAUSES)) % len(_HATCHES)],
        )
        for i, name in enumerate(causes)
    ]


def _bars(group: Sequence[Endings], kind: str, parts: Sequence[Part], score: str, setting: str) -> Plot:
    ncols = max(1, min(len(parts), _LETTERS // (max(len(short(part.name)) for part in parts) + 6)))
    game = group[0].game
    blinded = f", {score}" if score != SEEING else ""
    return Plot(
        lambda axis: _draw(axis, group, parts, ncols),
        title=f"{game}{blinded}: by {kind}",
        alt=f"How games ended in {game}{blinded}, by {kind}. " + " ".join(_words(group, parts)),
        caption=setting,
        facets={"game": game, "kind": kind, "score": score, "setting": group[0].setting},
        height=0.5 + 0.26 * len(group) + 0.17 * math.ceil(len(parts) / ncols),
    )


def _draw(axis: Axes, group: Sequence[Endings], parts: Sequence[Part], ncols: int) -> None:
    left = [0.0] * len(group)
    for part in parts:
        shares = [100 * n / ending.episodes for n, ending in zip(part.counts, group, strict=True)]
        axis.barh(
            range(len(group)),
            shares,
            left=left,
            height=0.72,
            color=part.colour,
            hatch=part.hatch,
            edgecolor=GROUND,
            linewidth=0.8,
            label=short(part.name),
        )
        left = [begin + share for begin, share in zip(left, shares, strict=True)]
    axis.set(xlim=(0, 100.4), ylim=(len(group) - 0.5, -0.5))
    axis.set_yticks(range(len(group)), [short(ending.column) for ending in group])
    axis.xaxis.set_major_formatter("{x:g} %")
    axis.grid(axis="y", visible=False)
    axis.get_figure().legend(loc="outside lower left", ncols=ncols, fontsize=8)  # type: ignore[union-attr]


def _words(group: Sequence[Endings], parts: Sequence[Part]) -> list[str]:
    return [
        f"{ending.column}: "
        + listing([(p.name, f"{percent(p.counts[i] / ending.episodes)} %") for p in parts if p.counts[i]])
        + "."
        for i, ending in enumerate(group)
    ]
