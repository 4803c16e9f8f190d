"""Caveats that a reader needs for interpreting the numbers, computed from the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from apil_core.evaluation.results import Rate
from apil_core.studies.bench.matrix import BASELINE
from apil_core.studies.curves.curves import WIN_OR_TIE
from apil_core.studies.report.grouping import Groups
from apil_core.studies.report.models import CurvePanel, Diagnostics, Unfinished, Warning
from apil_core.studies.report.published import published
from apil_core.studies.report.replayed import Replayed
from apil_core.studies.report.settings import Key, changed_options, game_of
from apil_core.studies.report.statistics import ENOUGH_SEEDS, compared
from apil_core.studies.report.table_models import Cell, MethodDifference, Setting, Table
from apil_core.studies.report.training_curves import RATIO, UNEVEN
from apil_core.studies.report.words import amount, percent, several

TIES = 0.9
"""Share of ties in win+tie from which on a warning is given."""

_FEW = 20
"""Games below which a share of them is not worth a warning."""

_LISTED = 5
"""Number of unfinished cells to name; all of them are listed elsewhere."""

_RARE = 0.01
"""Steps per game with non-opposite rewards below which Δr and r^α are the same objective."""


def _of_cell(kind: str, text: str, setting: str | None, game: str, column: str) -> Warning:
    return Warning(kind=kind, loud=False, text=text, setting=setting, game=game, column=column)


def setting_warnings(settings: Sequence[Setting], tables: Sequence[Table]) -> Iterator[Warning]:
    """Warnings about every number of a setting; once if they apply to all."""
    scored = {table.setting for table in tables}
    settings = [setting for setting in settings if setting.id in scored] or settings
    texts: dict[tuple[str, str], list[Setting]] = {}
    for setting in settings:
        for note in [*setting.notes, *_seed_notes(setting, tables)]:
            texts.setdefault((_kind(note), note), []).append(setting)
    for (kind, text), concerned in texts.items():
        if len(concerned) == len(settings):
            yield Warning(kind=kind, loud=True, text=text)
        else:
            for setting in concerned:
                yield Warning(kind=kind, loud=True, text=f"{setting.label}: {text}", setting=setting.id)


_KINDS = (
    ("of the published budget", "budget"),
    ("Actions are", "action modes"),
    ("physics", "physics"),
    ("seeds", "seeds"),
    ("Scores of", "episodes"),
    ("defaults", "settings"),
    ("victim", "victim"),
)


def _kind(note: str) -> str:
    return next((kind for words, kind in _KINDS if words in note), "settings")


def _seed_notes(setting: Setting, tables: Sequence[Table]) -> Iterator[str]:
    cells = [each for table in tables if table.setting == setting.id for each in table.cells]
    seeds = [each.seeds for each in cells if each.column != BASELINE and not each.replayed]
    if seeds and min(seeds) < ENOUGH_SEEDS:
        cells_text = "every cell" if max(seeds) < ENOUGH_SEEDS else "some cells"
        yield (
            f"Fewer than {ENOUGH_SEEDS} seeds in {cells_text} (least: {min(seeds)}): intervals cover the "
            "games of these agents, and how much other seeds would differ cannot be told."
        )
    games = [score.episodes for each in cells for score in each.scores]
    if games and min(games) < published().episodes:
        yield f"Scores of fewer than {published().episodes} games (least: {min(games)})."


def tie_warnings(tables: Sequence[Table]) -> Iterator[Warning]:
    """Scores of table 1 that are mostly ties, with the meaning of a tie where the endings show it."""
    cells = [each for table in tables if table.number in (1, 2) for each in table.cells]
    for table in tables:
        for each in table.cells if table.number == 1 else ():
            wins, ties = each.total("wins"), each.total("ties")
            if wins + ties >= _FEW and ties >= TIES * (wins + ties):
                meaning = tie_meaning(each, [other for other in cells if other.game == each.game])
                text = (
                    f"{each.column} in {each.game}: {100 * ties / (wins + ties):.0f} % of win+tie are ties "
                    f"({wins} wins and {ties} ties of {each.episodes} games){meaning}."
                )
                yield _of_cell("ties", text, table.setting, each.game, each.column)


def tie_meaning(own: Cell, game: Sequence[Cell]) -> str:
    """``"; a tie here means: keeper left goal"``, or a lower bound on the share of ties with one ending.

    Endings and outcomes are counted separately. If one ending's count equals the ties in every score of the
    game, ties are that ending. Otherwise the excess of an ending's count over wins and losses together is a
    lower bound on the ties with that ending.
    """
    ties = own.total("ties")
    tied = [(each.total("ties"), each.causes) for each in game if each.total("ties")]
    same = [cause for cause in own.causes if all(causes.get(cause, 0) == count for count, causes in tied)]
    if len(same) == 1:
        return f"; a tie here means: {same[0].replace('-', ' ')}"
    cause, count = next(iter(own.causes.items()), ("", 0))
    least = count - own.total("wins") - own.total("losses")
    if least >= 0.5 * ties:
        return f"; at least {100 * least / ties:.0f} % of the ties are: {cause.replace('-', ' ')}"
    return ""


def attack_warnings(
    tables: Sequence[Table],
    differences: Sequence[MethodDifference],
    panels: Sequence[CurvePanel],
    settings: Sequence[Setting],
) -> Iterator[Warning]:
    """Adversaries that do no better than the baseline, or than at the start of their training."""
    shares = {
        (table.id, each.game, each.column): each.win_or_tie.measured
        for table in tables
        if table.number == 1
        for each in table.cells
    }
    for each in differences:
        key = (each.table, each.game, each.column)
        if key in shares and each.base == BASELINE and each.win_or_tie_verdict != "higher":
            low, high = percent(each.win_or_tie.low), percent(each.win_or_tie.high)
            how = "is within noise of" if each.win_or_tie.within_noise else "is below"
            text = (
                f"{each.column} in {each.game} {how} the baseline adversary on win+tie "
                f"({100 * each.win_or_tie.value:+.1f} points [{low}, {high}])."
            )
            yield _of_cell("no attack", text, each.setting, each.game, each.column)
    comparable = {setting.id for setting in settings if setting.trained_physics == setting.physics}
    for (name, game, column), own in shares.items():
        setting = next(table.setting for table in tables if table.id == name)
        start = _start(panels, setting, game, column)
        if own is None or start is None or setting not in comparable:
            continue  # curves are of training games: scores in other physics are no continuation of them
        steps, rate = start
        if compared(own, rate).low <= 0.0:
            text = (
                f"{column} in {game} is not distinguishable on win+tie from its own beginning: "
                f"{percent(own.value)} % against {percent(rate.value)} % until {amount(steps)} steps."
            )
            yield _of_cell("no attack", text, setting, game, column)


def _start(panels: Sequence[CurvePanel], setting: str, game: str, method: str) -> tuple[int, Rate] | None:
    """Steps and win+tie at the first point of the curve, when the policy has hardly learnt."""
    for panel in panels:
        for group in panel.groups if (panel.setting, panel.game) == (setting, game) else ():
            first = group.lines.get(WIN_OR_TIE)
            if group.curves[0].method == method and first is not None and first.low:
                return first.steps[0], Rate(value=first.value[0], low=first.low[0], high=first.high[0])
    return None


def training_warnings(diagnostics: Sequence[Diagnostics]) -> Iterator[Warning]:
    """Imitators that learnt nothing, and games in which Δr and r^α are the same objective."""
    cells: dict[tuple[str, str, str], list[Diagnostics]] = {}
    for each in diagnostics:
        cells.setdefault((each.setting, each.game, each.method), []).append(each)
    for (setting, game, method), runs in cells.items():
        blind = [run.facts[RATIO] for run in runs if run.facts.get(RATIO, 0.0) >= 1.0]
        if blind:
            text = (
                f"{method} in {game}: in {len(blind)} of {several(len(runs), 'run')} the imitator predicts "
                f"the victim no better than the best constant action: {_times(blind)} times its error."
            )
            yield _of_cell("imitator", text, setting, game, method)
        rare = [run.facts[UNEVEN] for run in runs if run.facts.get(UNEVEN, 1.0) < _RARE]
        if rare and method != "adrl":
            text = (
                f"{method} in {game}: the sides' rewards failed to be opposite in {max(rare):.3f} steps per "
                "game at most, so Δr = r^α − r^ν says hardly more than r^α."
            )
            yield _of_cell("delta r", text, setting, game, method)


def _times(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def source_warnings(
    groups: Groups, named: Mapping[Key, Setting], unfinished: Sequence[Unfinished], tables: Sequence[Table]
) -> Iterator[Warning]:
    """Cells that are missing, outdated or duplicate; substitute baselines."""
    if unfinished:
        listed = ", ".join(f"{each.label} ({each.status})" for each in unfinished[:_LISTED])
        more = f" and {len(unfinished) - _LISTED} more" if len(unfinished) > _LISTED else ""
        yield Warning(
            kind="unfinished",
            loud=True,
            text=f"{several(len(unfinished), 'cell')} not finished: {listed}{more}.",
        )
    for place, members in groups.cells.items():
        for member in members:
            trained = member.score.trained_steps
            if trained is not None and trained < member.run.steps:
                text = (
                    f"{member.run.path}: score {member.name} is of {trained:,} steps, but the run has gone "
                    f"on to {member.run.steps:,}."
                )
                yield _of_cell("stale", text, named[place.key].id, place.game, place.method)
    for copy in groups.copies:
        text = f"{copy.run.path}: score {copy.name} is left out, the same attack with the same seed is there."
        yield _of_cell("copies", text, None, copy.run.config.env, copy.run.config.method)
    yield from _changed_options(groups, named)
    yield from _stand_ins(tables)


def left_out(groups: Groups, replayed: Sequence[Replayed]) -> Iterator[Warning]:
    """Adversaries of a matrix in whose games no run was scored."""
    for each in replayed:
        if each.note and not each.file and not groups.fits(each.score):
            yield Warning(
                kind="left out",
                loud=True,
                text=f"{each.label} in {each.score.env} is in no table: no run was scored in the same games.",
                game=each.score.env,
                column=each.label,
            )


def _changed_options(groups: Groups, named: Mapping[Key, Setting]) -> Iterator[Warning]:
    """Methods with options other than published; a benchmark's axes and variants are labelled already."""
    found: dict[tuple[str, str, str], dict[str, str]] = {}
    for place, members in groups.cells.items():
        if not place.key.variant:
            known = {name for name, _ in place.key.axes}
            texts = changed_options(members[0].run.config, known)
            found.setdefault((named[place.key].id, place.method, ", ".join(texts)), {})[place.game] = ""
    for (setting, method, text), games in found.items():
        if text:
            yield Warning(
                kind="settings",
                loud=True,
                text=f"{method} in {', '.join(games)} has not its default options: {text}.",
                setting=setting,
                column=method,
            )


def _stand_ins(tables: Sequence[Table]) -> Iterator[Warning]:
    """Baseline adversaries other than the game's own."""
    found = {
        (each.game, each.scores[0].source)
        for table in tables
        if table.number == 1
        for each in table.cells
        if each.column == BASELINE
    }
    for game, name in sorted(found):
        own = spec.baseline_adversary if (spec := game_of(game)) else None
        if own not in (None, name):
            text = f"{game}: the baseline adversary is {name}; {own} is not on the machine that scored it."
            yield _of_cell("baseline", text, None, game, BASELINE)
