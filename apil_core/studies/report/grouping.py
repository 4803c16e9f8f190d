"""Group the scores that may be averaged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from apil_core.config.resolve import differences
from apil_core.evaluation.results import EvaluationResult
from apil_core.studies.curves.groups import seed_groups
from apil_core.studies.report.replayed import Replayed
from apil_core.studies.report.settings import Key, conditions, key_of, key_without_run
from apil_core.studies.report.sources import Run

_UNTOLD = ("seed", "threads", "device", "recorders", "log_rows", "trust")


class Scored(NamedTuple):
    """One score of one run."""

    run: Run
    name: str
    score: EvaluationResult


class Place(NamedTuple):
    """Key of a group: one cell of one table."""

    key: Key
    blind: str | None
    game: str
    method: str


@dataclass(frozen=True)
class Groups:
    """All scores, grouped.

    Attributes:
        cells: one entry per seed; seeds rise.
        unscored: runs without any score, with the key of where it would go.
        copies: scores left out because the same attack with the same seed is already included.
        variants: differences of the runs of a key with ``variant`` > 0 from those with 0.
        alone: scores of other adversaries in games in which no run was scored.
    """

    cells: dict[Place, list[Scored]] = field(default_factory=dict)
    unscored: list[tuple[Key, Run]] = field(default_factory=list)
    copies: list[Scored] = field(default_factory=list)
    variants: dict[Key, str] = field(default_factory=dict)
    alone: dict[Key, list[Replayed]] = field(default_factory=dict)

    def settings(self) -> list[Key]:
        """All settings, in the order of appearance."""
        unscored = (key for key, _ in self.unscored)
        return list(dict.fromkeys([*(place.key for place in self.cells), *unscored, *self.alone]))

    def members(self, key: Key, game: str, method: str, blind: str | None = None) -> list[Scored]:
        """The scores of one cell."""
        return self.cells.get(Place(key, blind, game, method), [])

    def modes(self, key: Key) -> list[str | None]:
        """How adversaries were blinded in a setting; not at all first."""
        found = {place.blind for place in self.cells if place.key == key}
        found |= {blinding(each.score) for each in self.alone.get(key, ())}
        return sorted(found, key=lambda mode: (mode is not None, str(mode)))

    def replayed(
        self, all_of_them: Sequence[Replayed], key: Key, blind: str | None, game: str, column: str
    ) -> Replayed | None:
        """The score of that column in the games of a row; the one with most games if there are several."""
        place = (column, game, blind)
        own = [e for e in all_of_them if (e.label, e.score.env, blinding(e.score)) == place]
        if key in self.alone:
            found = [each for each in self.alone[key] if each in own]
        else:
            found = [each for each in own if self.fits(each.score, key)]
        return max(found, key=lambda each: each.score.episodes, default=None)

    def fits(self, score: EvaluationResult, key: Key | None = None) -> bool:
        """Return whether a run was scored in the same games, in that setting's table or in any."""
        return any(
            conditions(score) == conditions(member.score)
            for place, members in self.cells.items()
            if key in (None, place.key) and place.blind == blinding(score)
            for member in members
        )


def group(runs: Sequence[Run], replayed: Sequence[Replayed] = ()) -> Groups:
    """Group all scores, with those of other adversaries that need a setting of their own."""
    found = _grouped(runs)
    for each in replayed:
        if each.alone and not found.fits(each.score):
            found.alone.setdefault(key_without_run(each.score), []).append(each)
    return found


def _grouped(runs: Sequence[Run]) -> Groups:
    found = Groups()
    attack = {
        place: number for number, places in enumerate(seed_groups([r.dir for r in runs])) for place in places
    }
    seen: dict[tuple[Key, str, str], list[tuple[int, Any, Run]]] = {}
    for number, run in enumerate(runs):
        if not run.scores:
            found.unscored.append((key_of(run, None), run))
        for name, score in run.scores.items():
            scored = Scored(run, name, score)
            place = Place(
                _place(scored, attack[number], seen, found),
                blinding(score),
                run.config.env,
                run.config.method,
            )
            members = found.cells.setdefault(place, [])
            if any(member.run.config.seed == run.config.seed for member in members):
                found.copies.append(scored)
                continue
            members.append(scored)
            members.sort(key=lambda member: member.run.config.seed)
    return found


def blinding(score: EvaluationResult) -> str | None:
    """Describe the adversary's blinding."""
    if score.blind is None:
        return None
    return f"{score.blind}, imitator too" if score.blind_imitator else score.blind


def _place(
    scored: Scored, attack: int, seen: dict[tuple[Key, str, str], list[tuple[int, Any, Run]]], found: Groups
) -> Key:
    """A score's key and variant: the same for runs that differ in the seed only, and for copies."""
    run, how = scored.run, conditions(scored.score)
    key = key_of(run, scored.score)
    known = seen.setdefault((key, run.config.env, run.config.method), [])
    for variant, (other, theirs, first) in enumerate(known):
        if how == theirs and (other == attack or not _telling(first, run)):
            return replace(key, variant=variant)
    known.append((attack, how, run))
    own = replace(key, variant=len(known) - 1)
    if own.variant:
        found.variants.setdefault(own, _telling(known[0][2], run) or f"other victim or options ({run.path})")
    return own


def _telling(first: Run, run: Run) -> str:
    """Settings other than the seed in which two runs of one cell differ."""
    different = differences(first.config, run.config)
    facts = [
        f"{key} {b} instead of {a}"
        for key, (a, b) in different.items()
        if key not in _UNTOLD and not key.startswith(("checkpoint.", "evaluation."))
    ]
    if first.dir.processes() != run.dir.processes():
        facts.append(f"{run.dir.processes()} processes instead of {first.dir.processes()}")
    return ", ".join(facts)
