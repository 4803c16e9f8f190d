"""Figures of game endings: the winner, and the rule that ended the game."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from apil_core.studies.report.figures.palette import CAUSES, GROUND, placeholder
from apil_core.studies.report.figures.plot import Plot, listing, short
from apil_core.studies.report.table_models import Cell, Table
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


def ending_bars(tables: Sequence[Table], settings: Mapping[str, str]) -> list[Plot]:
    """Make two figures for each game of tables 1 and 2: by outcome and by cause, a bar for each column.

    Args:
        tables: cells without games are left out.
        settings: labels by id, where there are several.
    """
    rows = [(table, [c for c in row if c.episodes]) for table in tables for row in table.rows]
    causes: dict[str, Counter[str]] = {}
    for cell in (cell for _, row in rows for cell in row):
        causes.setdefault(cell.game, Counter()).update(cell.causes)
    plots = []
    for table, row in ((table, row) for table, row in rows if row):
        outcomes = [Part(name, [cell.total(key) for cell in row], c, h) for name, key, c, h in _OUTCOMES]
        counted = [
            Part(
                name,
                [cell.causes.get(name, 0) for cell in row],
                # a cause has one colour in all figures of its game; a repeated one has another pattern
                CAUSES[i % len(CAUSES)],
                _HATCHES[(i + i // len(CAUSES)) % len(_HATCHES)],
            )
            for i, (name, _) in enumerate(causes[row[0].game].most_common())
        ]
        plots += [
            _bars(table, row, "outcome", outcomes, settings),
            _bars(table, row, "cause", counted, settings),
        ]
    return plots


def _bars(
    table: Table, row: Sequence[Cell], kind: str, parts: Sequence[Part], settings: Mapping[str, str]
) -> Plot:
    ncols = max(1, min(len(parts), _LETTERS // (max(len(short(part.name)) for part in parts) + 6)))
    game, score = row[0].game, f"blinded: {table.blind}" if table.blind else SEEING
    what = f"{game}, {score}" if table.blind else game
    words = [
        f"{cell.column}: "
        + listing([(p.name, f"{percent(p.counts[i] / cell.episodes)} %") for p in parts if p.counts[i]])
        for i, cell in enumerate(row)
    ]
    return Plot(
        lambda axis: _draw(axis, row, parts, ncols),
        title=f"{what}: by {kind}",
        alt=f"How games ended in {what}, by {kind}. {'. '.join(words)}.",
        caption=settings.get(table.setting, ""),
        facets={"game": game, "kind": kind, "score": score, "setting": table.setting},
        height=0.5 + 0.26 * len(row) + 0.17 * math.ceil(len(parts) / ncols),
    )


def _draw(axis: Axes, row: Sequence[Cell], parts: Sequence[Part], ncols: int) -> None:
    left = [0.0] * len(row)
    for part in parts:
        shares = [100 * n / cell.episodes for n, cell in zip(part.counts, row, strict=True)]
        axis.barh(
            range(len(row)),
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
    axis.set(xlim=(0, 100.4), ylim=(len(row) - 0.5, -0.5))
    axis.set_yticks(range(len(row)), [short(cell.column) for cell in row])
    axis.xaxis.set_major_formatter("{x:g} %")
    axis.grid(axis="y", visible=False)
    axis.get_figure().legend(loc="outside lower left", ncols=ncols, fontsize=8)  # type: ignore[union-attr]
