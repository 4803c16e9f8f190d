"""Tables 1 and 2: adversaries against the victim, unblinded and blinded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from apil_core.studies.bench.matrix import BASELINE as BASELINE
from apil_core.studies.report.cells import cell, make_table, seed_score, seed_scores
from apil_core.studies.report.grouping import Groups
from apil_core.studies.report.labels import cell_marks
from apil_core.studies.report.models import Endings
from apil_core.studies.report.published import published
from apil_core.studies.report.settings import Key
from apil_core.studies.report.sources import Sources
from apil_core.studies.report.statistics import compared, verdict
from apil_core.studies.report.table_models import Cell, MethodDifference, Setting, Table

_TITLES = {1: "Adversaries against the victim", 2: "Blinded adversaries against the victim"}


def columns_of(sources: Sources) -> list[str]:
    """Baseline, the paper's methods, others; the paper's whenever one of its games is present."""
    known = published().columns
    if not set(sources.games) & set(published().games):
        known = [name for name in known if name == BASELINE or name in sources.methods]
    return list(dict.fromkeys([*known, *sources.methods]))


def attack_tables(
    sources: Sources,
    groups: Groups,
    named: Mapping[Key, Setting],
    games: Sequence[str],
    columns: Sequence[str],
) -> list[Table]:
    """Tables 1 and 2 of every setting that has cells."""
    labels = [label for label in dict.fromkeys(each.label for each in sources.replayed) if label != BASELINE]
    tables = []
    for key, setting in named.items():
        for blind in groups.modes(key):
            shown = [*_columns(groups, key, columns), *labels]
            rows = [_row(sources, groups, key, setting, blind, game, shown) for game in games]
            rows = [
                row
                for row in rows
                if any(
                    c.scores for c in row if key in groups.alone or not (c.replayed or c.column == BASELINE)
                )
            ]
            empty = [
                label for label in labels if not any(c.scores for r in rows for c in r if c.column == label)
            ]
            shown = [column for column in shown if column not in empty]
            rows = [[c for c in row if c.column not in empty] for row in rows]
            number: Literal[1, 2] = 1 if blind is None else 2
            tables.append(make_table(number, _TITLES[number], setting.id, shown, rows, blind))
    return sorted(tables, key=lambda table: table.number)


def _changed(key: Key) -> bool:
    """Return whether its methods differ from the published ones."""
    return key.changes_method or key.variant > 0


def _columns(groups: Groups, key: Key, columns: Sequence[str]) -> list[str]:
    """All columns, or of changed methods only those that were measured."""
    if not _changed(key):
        return list(columns)
    measured = {place.method for place in groups.cells if place.key == key}
    return [column for column in columns if column == BASELINE or column in measured]


def _row(
    sources: Sources,
    groups: Groups,
    key: Key,
    setting: Setting,
    blind: str | None,
    game: str,
    columns: Sequence[str],
) -> list[Cell]:
    source = published().tables[1 if blind is None else 2]
    cells = []
    for column in columns:
        value = None if _changed(key) and column != BASELINE else source.value(game, column)
        scores = seed_scores(groups.members(key, game, column, blind))
        trained = len(scores)
        note = ""
        if (other := groups.replayed(sources.replayed, key, blind, game, column)) is not None:
            scores, note = [seed_score(other.score, other.source)], other.note
        least = min((score.episodes for score in scores), default=published().episodes)
        marks = cell_marks(setting, game, trained, least) if scores else []
        found = cell(game, column, scores, value, [note, *marks] if note else marks)
        cells.append(found.model_copy(update={"replayed": note}))
    return cells


def method_differences(tables: Sequence[Table]) -> list[MethodDifference]:
    """Compare every measured column with every measured one before it."""
    found = []
    for table in tables:
        for row in table.rows:
            measured = [each for each in row if each.scores]
            for i, each in enumerate(measured):
                found += [_difference(table, each, base) for base in measured[:i]]
    return found


def _difference(table: Table, own: Cell, base: Cell) -> MethodDifference:
    shares = [(own.win.measured, base.win.measured), (own.win_or_tie.measured, base.win_or_tie.measured)]
    win, either = (compared(a, b) for a, b in shares if a is not None and b is not None)
    return MethodDifference(
        table=table.id,
        setting=table.setting,
        game=own.game,
        column=own.column,
        base=base.column,
        win=win,
        win_or_tie=either,
        win_verdict=verdict(win),
        win_or_tie_verdict=verdict(either),
    )


def endings(tables: Sequence[Table]) -> list[Endings]:
    """The endings of the games of every cell of tables 1 and 2."""
    return [
        _endings(table, each)
        for table in tables
        if table.number in (1, 2)
        for row in table.rows
        for each in row
        if each.scores
    ]


def _endings(table: Table, own: Cell) -> Endings:
    counts: dict[str, int] = {}
    for score in own.scores:
        for cause, count in score.causes.items():
            counts[cause] = counts.get(cause, 0) + count
    return Endings(
        table=table.id,
        setting=table.setting,
        game=own.game,
        column=own.column,
        episodes=own.episodes,
        wins=sum(score.wins for score in own.scores),
        ties=sum(score.ties for score in own.scores),
        losses=sum(score.losses for score in own.scores),
        causes=dict(sorted(counts.items(), key=lambda item: -item[1])),
        mean_length=sum(score.mean_length * score.episodes for score in own.scores) / own.episodes,
    )
