"""Tables 3 and 4: retrained victims against the baseline and the E-APIL adversary, from cross-plays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from apil_core.common.errors import ApilError
from apil_core.evaluation.crossplay.document import CrossPlay, Player
from apil_core.evaluation.results import EvaluationResult
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.studies.bench.jobs import labels
from apil_core.studies.bench.matrix import BASELINE
from apil_core.studies.report.cells import cell, make_table, seed_score
from apil_core.studies.report.labels import assignments, cell_marks, in_paper, make_setting
from apil_core.studies.report.published import published
from apil_core.studies.report.settings import Key, key_of, victim_kind
from apil_core.studies.report.sources import Sources, StoredBench
from apil_core.studies.report.table_models import SeedScore, Setting, Table
from apil_core.studies.report.words import amount

ORIGINAL, AGAINST = "original", "vs "
"""Label of the original victim, and prefix (before the adversary's label) of retrained ones."""

STRONGEST = "e_apil"
"""Method of table 4's adversary."""


class _Entry(NamedTuple):
    number: int
    block: Key
    game: str
    column: str
    score: SeedScore


class Played(NamedTuple):
    """A cross-play with data that its labels do not contain.

    Attributes:
        retrain_steps: the benchmark's budget of retraining.
        attacks: keys of the adversaries that are runs of this report, by label.
    """

    document: CrossPlay
    retrain_steps: int | None
    attacks: Mapping[str, Key]

    def axes(self, label: str) -> tuple[tuple[str, str], ...]:
        """Axes of the adversary of that label."""
        return self.attacks[label].axes if label in self.attacks else ()

    def attacked(self, label: str) -> str | None:
        """Kind of the victim that the adversary of that label was trained against, if that is known."""
        return self.attacks[label].victim if label in self.attacks else None

    def steps(self, label: str) -> int | None:
        """Training budget of the adversary of that label; ``None`` if it was not trained here."""
        labels = [player.label for player in self.document.adversaries]
        row = self.document.scores[labels.index(label)] if label in labels else []
        trained = next((score.trained_steps for score in row if score is not None), None)
        if trained is None or label not in self.attacks:
            return trained
        return min(trained, self.attacks[label].steps or 0)


def crossplays(sources: Sources) -> list[Played]:
    """The cross-plays of all benchmarks that have any game, and those that were named."""
    attacks = {str(Path(run.path).resolve()): key_of(run, None) for run in sources.runs}
    found = []
    for bench, matrix in sources.benches.values():
        steps = matrix.retraining.steps if matrix.retraining else None
        for game in matrix.games:
            document = sources.read(CrossPlay.stored, bench.crossplay_path(game))
            if document is not None and document.played:
                found.append(Played(document, steps, _known(bench, document, attacks)))
    return [*found, *(Played(document, None, {}) for document in sources.crossplays if document.played)]


def _known(bench: StoredBench, document: CrossPlay, attacks: Mapping[str, Key]) -> dict[str, Key]:
    """Attacks by label; after a benchmark was moved its cells still have their labels."""
    cells = labels(bench.benchmark.cells_of(document.env))
    paths = {label: str(bench.cell(name).path.resolve()) for name, label in cells.items()}
    paths |= {p.label: path for p in document.adversaries if (path := p.name.removeprefix("run:")) in attacks}
    return {label: attacks[path] for label, path in paths.items() if path in attacks}


def retrained_tables(
    documents: Sequence[Played], games: Sequence[str], columns: Sequence[str], begin: int
) -> tuple[list[Table], list[Setting]]:
    """Tables 3 and 4 with their settings.

    Args:
        documents: see :func:`crossplays`.
        games, columns: in the report's order.
        begin: number of the first setting's id.
    """
    entries = [entry for played in documents for entry in _entries(played)]
    blocks = list(dict.fromkeys(entry.block for entry in entries if entry.column != BASELINE))
    tables: list[Table] = []
    settings = []
    for i, block in enumerate(blocks):
        paper = in_paper(entry.game for entry in entries if entry.block == block)
        settings.append(make_setting(f"s{begin + i}", _label(block), block, paper=paper, retrained=True))
    for number in (3, 4):
        for block, setting in zip(blocks, settings, strict=True):
            own = [entry for entry in entries if entry.number == number and _belongs(entry, block)]
            tables.append(_table(number, setting, own, games, columns))
    return [table for table in tables if table.rows], settings


def _belongs(entry: _Entry, block: Key) -> bool:
    """Return whether a score belongs to a block; the original victim's fits every block of equal settings."""
    own = entry.block
    if entry.column == BASELINE and own.steps in (None, block.steps):
        return replace(own, steps=block.steps, retrain_steps=block.retrain_steps, axes=block.axes) == block
    return own == block


def _entries(played: Played) -> Iterator[_Entry]:
    """The victims' scores, from their side."""
    document = played.document
    for victim in document.victims:
        original = _is_original(victim)
        name = victim.label.removeprefix(AGAINST)
        if not original and name == victim.label:
            continue  # neither the original victim nor one retrained against a method
        teacher = next((player for player in document.adversaries if player.label == name), None)
        for number, opponent in _opponents(played, teacher, _attacked(played, victim), original):
            score = document.score(opponent.label, victim.label)
            if score is not None:
                seed = teacher.seed if teacher else None if number == 3 else opponent.seed
                steps = played.steps(opponent.label if original else name)
                yield _Entry(
                    number,
                    _block(played, victim, score, steps, original),
                    document.env,
                    BASELINE if original else name.partition("/")[0],
                    seed_score(score, f"{opponent.label} against {victim.label}", seed, "victim"),
                )


def _opponents(
    played: Played, teacher: Player | None, attacked: str, original: bool
) -> Iterator[tuple[int, Player]]:
    """A victim's opponents in tables 3 and 4: the baseline; E-APIL's, unablated, of its own budget and seed.

    The original victim's opponents have any budget and seed, and were trained against it.

    Args:
        teacher: the adversary it was retrained against.
        attacked: kind of the original victim.
        original: it was not.
    """
    document = played.document
    yield from ((3, player) for player in document.adversaries if player.label == BASELINE)
    strongest = [p for p in document.adversaries if p.method == STRONGEST and not played.axes(p.label)]
    usual = [p for p in strongest if played.attacked(p.label) in (None, attacked)]
    if not original and teacher is not None:
        steps = played.steps(teacher.label)
        same_budget = [p for p in usual if played.steps(p.label) == steps] or usual
        usual = ([p for p in same_budget if p.seed == teacher.seed] or same_budget)[:1]
    yield from ((4, player) for player in usual)


def _block(
    played: Played, victim: Player, score: EvaluationResult, trained: int | None, original: bool
) -> Key:
    retraining = None if original else _retraining(victim)
    return Key(
        steps=trained,
        retrain_steps=None if original else retraining.steps if retraining else played.retrain_steps,
        trained=score.physics,
        physics=score.physics,
        victim=_attacked(played, victim),
        adversary_actions=score.adversary_actions,
        victim_actions=score.victim_actions,
        axes=() if original else played.axes(victim.label.removeprefix(AGAINST)),
    )


def _attacked(played: Played, victim: Player) -> str:
    """Kind of the victim itself, or of the one it was retrained from."""
    document = played.document
    if _is_original(victim):
        return victim_kind(document.env, victim.name)
    retraining = _retraining(victim)
    firsts = [player.name for player in document.victims if player.label == ORIGINAL]
    return victim_kind(document.env, retraining.victim if retraining else firsts[0] if firsts else "")


def _is_original(victim: Player) -> bool:
    return victim.label.partition(" ")[0] == ORIGINAL


def _retraining(victim: Player) -> RetrainConfig | None:
    """Settings of its retraining, if its directory still exists."""
    try:
        return RetrainDir(Path(victim.name.partition(":")[2])).config()
    except ApilError:
        return None


def _table(
    number: int, setting: Setting, entries: Sequence[_Entry], games: Sequence[str], columns: Sequence[str]
) -> Table:
    source = published().tables[number]
    rows = []
    for game in games:
        own = [entry for entry in entries if entry.game == game]
        if not any(entry.column != BASELINE for entry in own):
            continue
        row = []
        for column in columns:
            found = {(e.score.seed, e.score.source): e.score for e in reversed(own) if e.column == column}
            scores = list(reversed(found.values()))
            marks = cell_marks(setting, game, scores, trained=column != BASELINE)
            changed = setting.axes and column != BASELINE
            row.append(cell(game, column, scores, None if changed else source.value(game, column), marks))
        rows.append(row)
    return make_table(number, setting.id, columns, rows)


def _label(key: Key) -> str:
    facts = [] if key.steps is None else [f"{amount(key.steps)} steps"]
    facts += [f"{key.physics} physics"] if key.physics else []
    facts += [f"victims retrained for {amount(key.retrain_steps)} steps"] if key.retrain_steps else []
    facts += [f"against adversaries with {assignments(key.axes)}"] if key.axes else []
    return ", ".join(facts)
