"""How games ended: who won, and by which rule of the game."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from apil_core.studies.report.figures.palette import CAUSES, GROUND, PATTERNS
from apil_core.studies.report.figures.plot import Plot, listing, spec, text
from apil_core.studies.report.models import Endings
from apil_core.studies.report.words import percent

SEEING = "seeing adversary"
"""Of scores in which nothing is hidden from it."""

_WIDTH = 380
"""CSS pixels of a figure's legend where two stand side by side."""

_OUTCOMES = (
    ("adversary wins", "wins", "var(--adversary)", ""),
    ("tie", "ties", "var(--tie)", "/"),
    ("victim wins", "losses", "var(--victim)", ""),
)


def ending_bars(endings: Sequence[Endings], scores: dict[str, str], settings: dict[str, str]) -> list[Plot]:
    """Two figures for each game of a table: by outcome and by cause, a bar for each column.

    Args:
        endings: those without games are left out.
        scores: what the adversary saw, by table, e.g. ``"blinded: zeros"``.
        settings: labels by id, where there are several.
    """
    groups: dict[tuple[str, str], list[Endings]] = {}
    for ending in endings:
        if ending.episodes:
            groups.setdefault((ending.table, ending.game), []).append(ending)
    causes = _causes(endings)
    plots = []
    for (table, game), group in groups.items():
        words, score = settings.get(group[0].setting, ""), scores.get(table, table)
        outcomes = [(name, [getattr(e, key) for e in group], colour, p) for name, key, colour, p in _OUTCOMES]
        plots += [
            _bars(group, "outcome", outcomes, score, words),
            _bars(group, "cause", _counted(group, causes[game]), score, words),
        ]
    return plots


Part = tuple[str, list[int], str, str]
"""Name, counts for each column, colour and pattern."""


def _causes(endings: Sequence[Endings]) -> dict[str, list[str]]:
    """Causes of each game, most frequent first: a cause has one colour in all figures of its game."""
    counts: dict[str, Counter[str]] = {}
    for ending in endings:
        counts.setdefault(ending.game, Counter()).update(ending.causes)
    return {game: [name for name, _ in counted.most_common()] for game, counted in counts.items()}


def _counted(group: Sequence[Endings], causes: Sequence[str]) -> list[Part]:
    return [
        (
            name,
            [ending.causes.get(name, 0) for ending in group],
            f"var(--cause-{i % len(CAUSES)})",
            # a colour that comes again has another pattern
            PATTERNS[(i + i // len(CAUSES)) % len(PATTERNS)],
        )
        for i, name in enumerate(causes)
    ]


def _legend_rows(names: Sequence[str]) -> int:
    """Rows that plotly needs: all entries are as wide as the longest, and with too few the legend scrolls."""
    entry = 45 + 7 * max(len(name) for name in names)
    return math.ceil(len(names) / max(1, _WIDTH // entry))


def _bars(group: Sequence[Endings], kind: str, parts: Sequence[Part], score: str, setting: str) -> Plot:
    rows = _legend_rows([part[0] for part in parts])
    figure = spec(
        [_trace(group, part) for part in parts],
        40 + 30 * len(group) + 19 * rows,
        x={"range": [0, 100.4], "ticksuffix": " %", "dtick": 25},
        y={"autorange": "reversed", "type": "category", "showgrid": False},
        barmode="stack",
        bargap=0.28,
        showlegend=True,
        legend={
            "orientation": "h",
            "x": 0,
            "y": 0,
            "yref": "container",
            "yanchor": "bottom",
            "traceorder": "normal",
        },
        margin={"l": 70, "r": 24, "t": 6, "b": 26 + 19 * rows},
    )
    game = group[0].game
    blinded = f", {score}" if score != SEEING else ""
    return Plot(
        figure,
        title=f"{game}{blinded}: by {kind}",
        alt=f"How games ended in {game}{blinded}, by {kind}. " + " ".join(_words(group, parts)),
        caption=setting,
        facets={"game": game, "kind": kind, "score": score, "setting": group[0].setting},
    )


def _trace(group: Sequence[Endings], part: Part) -> dict[str, Any]:
    name, counts, colour, pattern = part
    return {
        "type": "bar",
        "orientation": "h",
        "y": [text(ending.column) for ending in group],
        "x": [round(100 * n / ending.episodes, 2) for n, ending in zip(counts, group, strict=True)],
        "name": text(name),
        "customdata": counts,
        "marker": {
            "color": colour,
            "line": {"color": GROUND, "width": 1},
            "pattern": {"shape": pattern, "bgcolor": colour, "fgcolor": GROUND, "size": 7, "solidity": 0.25},
        },
        "hovertemplate": "%{x:.1f} % (%{customdata} games)",
    }


def _words(group: Sequence[Endings], parts: Sequence[Part]) -> list[str]:
    return [
        f"{ending.column}: "
        + listing(
            [(name, f"{percent(counts[i] / ending.episodes)} %") for name, counts, _, _ in parts if counts[i]]
        )
        + "."
        for i, ending in enumerate(group)
    ]
