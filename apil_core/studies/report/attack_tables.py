"""Tables 1 and 2: adversaries against the victim, unblinded and blinded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from apil_core.evaluation.results import EvaluationResult
from apil_core.studies.report.cells import cell, make_table, seed_score, seed_scores
from apil_core.studies.report.grouping import Groups, blinding
from apil_core.studies.report.labels import cell_marks
from apil_core.studies.report.models import Endings
from apil_core.studies.report.published import published
from apil_core.studies.report.settings import Key
from apil_core.studies.report.sources import Sources
from apil_core.studies.report.statistics import compared, verdict
from apil_core.studies.report.table_models import Cell, MethodDifference, Setting, Table

BASELINE = "baseline"
_TITLES = {1: "Adversaries against the victim", 2: "Blinded adversaries against the victim"}


def columns_of(sources: Sources) -> list[str]:
    """Baseline, the paper's methods, others; the paper's whenever one of its games is present."""
    measured = [run.config.method for run in sources.runs] + [cell.method for cell in sources.missing]
    known = published().columns
    if not set(sources.games) & set(published().games):
        known = [name for name in known if name == BASELINE or name in measured]
    return list(dict.fromkeys([*known, *measured]))


def attack_tables(
    sources: Sources,
    groups: Groups,
    named: Mapping[Key, Setting],
    games: Sequence[str],
    columns: Sequence[str],
) -> list[Table]:
    """Tables 1 and 2 of every setting that has cells."""
    tables = []
    for key, setting in named.items():
        modes = dict.fromkeys(place.blind for place in groups.cells if place.key == key)
        for blind in sorted(modes, key=lambda mode: (mode is not None, str(mode))):
            shown = _columns(groups, key, columns)
            rows = [_row(sources, groups, key, setting, blind, game, shown) for game in games]
            found = [row for row in rows if any(c.scores for c in row if c.column != BASELINE)]
            number: Literal[1, 2] = 1 if blind is None else 2
            tables.append(make_table(number, _TITLES[number], setting.id, shown, found, blind))
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
        if column == BASELINE:
            found = _baseline(sources, groups, key, blind, game)
            scores = [] if found is None else [seed_score(found, found.adversary.name)]
        else:
            scores = seed_scores(groups.members(key, game, column, blind))
        trained = 0 if column == BASELINE else len(scores)
        games = min((score.episodes for score in scores), default=published().episodes)
        cells.append(
            cell(game, column, scores, value, cell_marks(setting, game, trained, games) if scores else ())
        )
    return cells


def _baseline(
    sources: Sources, groups: Groups, key: Key, blind: str | None, game: str
) -> EvaluationResult | None:
    """The baseline adversary's score in the same games; the one with most games if there are several."""
    members = [m for place, ms in groups.cells.items() if (place.key, place.game) == (key, game) for m in ms]
    played = [(member.score.options_played, member.score.observers or {}) for member in members]
    victims = [member.score.victim for member in members]
    found = [
        score
        for score in sources.baselines
        if score.env == game
        and blinding(score) == blind
        and score.physics == key.physics
        and score.victim in victims
        and (score.adversary_actions, score.victim_actions) == (key.adversary_actions, key.victim_actions)
        and (score.options_played, score.observers or {}) in played
    ]
    return max(found, key=lambda score: score.episodes, default=None)


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
