"""Tables 1 and 2: adversaries against the victim, unblinded and blinded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from apil_core.studies.bench.matrix import BASELINE
from apil_core.studies.report.cells import cell, make_table, method_difference, seed_score, seed_scores
from apil_core.studies.report.grouping import Groups
from apil_core.studies.report.labels import cell_marks
from apil_core.studies.report.published import published
from apil_core.studies.report.settings import Key
from apil_core.studies.report.sources import Sources
from apil_core.studies.report.table_models import Cell, MethodDifference, Setting, Table


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
            rows = [row for row in rows if any(key in groups.alone or _own(c) for c in row if c.scores)]
            filled = {cell.column for row in rows for cell in row if cell.scores}
            shown = [column for column in shown if column in filled or column not in labels]
            rows = [[cell for cell in row if cell.column in shown] for row in rows]
            tables.append(make_table(1 if blind is None else 2, setting.id, shown, rows, blind))
    return sorted(tables, key=lambda table: table.number)


def _own(cell: Cell) -> bool:
    return not (cell.replayed or cell.column == BASELINE)


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
        trained, note = bool(scores), ""
        if (other := groups.replayed(sources.replayed, key, blind, game, column)) is not None:
            scores, note = [seed_score(other.score, other.source)], other.note
        marks = [note] * bool(note) + cell_marks(setting, game, scores, trained=trained)
        cells.append(cell(game, column, scores, value, marks).model_copy(update={"replayed": note}))
    return cells


def method_differences(tables: Sequence[Table]) -> list[MethodDifference]:
    """Compare every measured column with every measured one before it."""
    found = []
    for table in tables:
        for row in table.rows:
            measured = [each for each in row if each.scores]
            for i, each in enumerate(measured):
                named = {"table": table.id, "setting": table.setting}
                found += [method_difference(each, base, **named) for base in measured[:i]]
    return found
