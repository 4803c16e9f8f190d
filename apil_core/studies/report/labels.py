"""Descriptions of settings, and reasons why their numbers are weaker than the published ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from apil_core.api.profiles import FAITHFUL
from apil_core.studies.report.grouping import Groups
from apil_core.studies.report.published import published
from apil_core.studies.report.settings import DEFAULT_VICTIM, STUDENT, Key, varying
from apil_core.studies.report.statistics import ENOUGH_SEEDS
from apil_core.studies.report.table_models import SeedScore, Setting
from apil_core.studies.report.words import amount, budget_mark, several

PUBLISHED_MODE = "mode"
"""Action modes of both sides in the published evaluation code (docs/fidelity.md)."""

_ALWAYS = ("steps", "physics")

_SHARED = ("steps", "retrain_steps", "physics", "victim", "adversary_actions", "victim_actions")
"""Attributes of a key that a setting has by the same name."""


def settings(groups: Groups) -> dict[Key, Setting]:
    """Make a setting for every key, the one with most cells first."""
    keys = _in_order(groups)
    texts = {key: _texts(key, groups) for key in keys}
    shown = {*varying(texts.values()), *_ALWAYS}
    named: dict[Key, Setting] = {}
    for number, key in enumerate(keys, 1):
        label = ", ".join(text for name, text in texts[key].items() if name in shown and text)
        games = {place.game for place in groups.cells if place.key == key}
        games |= {run.config.env for other, run in groups.unscored if other == key}
        games |= {each.score.env for each in groups.alone.get(key, ())}
        named[key] = make_setting(f"s{number}", label, key, paper=in_paper(games))
    return named


def in_paper(games: Iterable[str]) -> bool:
    """Return whether the paper has one of these games; its budgets do not apply to others."""
    return bool(set(games) & set(published().games))


def _in_order(groups: Groups) -> list[Key]:
    """Sort: most cells, no further axes, largest budget, faithful physics."""
    cells = {
        key: sum(place.key == key and place.blind is None for place in groups.cells)
        for key in groups.settings()
    }
    return sorted(
        cells,
        key=lambda key: (
            *(not cells[key], key.variant, len(key.scored_with), len(key.axes), len(key.other)),
            *(-cells[key], -(key.steps or 0), key.physics != FAITHFUL),
        ),
    )


def _texts(key: Key, groups: Groups) -> dict[str, str]:
    return {
        "steps": "not trained here" if key.steps is None else f"{amount(key.steps)} steps",
        "physics": _physics(key),
        "victim": {DEFAULT_VICTIM: "", STUDENT: "embedded students as victims"}.get(
            key.victim, f"victim {key.victim}"
        ),
        "actions": f"actions {_modes(key.adversary_actions, key.victim_actions)}",
        "axes": assignments(key.axes),
        "other": assignments(key.other),
        "scored_with": _defences(key),
        "variant": groups.variants.get(key, ""),
    }


def _defences(key: Key) -> str:
    return ", ".join(f"{name} ({options})" for name, options in key.scored_with)


def _physics(key: Key) -> str:
    if key.physics is None:
        return ""
    if key.trained == key.physics:
        return f"{key.physics} physics"
    return f"trained in {key.trained}, played in {key.physics} physics"


def _modes(own: str, victims: str) -> str:
    words = {"sample": "sampled", "mode": "mode"}
    return f"{words.get(own, own)}/{words.get(victims, victims)}"


def assignments(pairs: Sequence[tuple[str, str]]) -> str:
    """``key=value`` of each pair."""
    return ", ".join(f"{name}={value}" for name, value in pairs)


def make_setting(name: str, label: str, key: Key, *, paper: bool, retrained: bool = False) -> Setting:
    """Make a setting.

    Args:
        name, label: its id, and its description.
        key: of its cells.
        paper: whether the paper played one of its games.
        retrained: of tables 3 and 4: its budget is that of the victims' retraining.
    """
    budgets = published()
    full = (budgets.retrain_steps if retrained else budgets.adversary_steps) if paper else None
    own = key.retrain_steps if retrained else key.steps
    notes = []
    if retrained and (mark := budget_mark(own, full)):
        notes.append(f"Victims retrained for {mark} of the published budget.")
    notes += _notes(key, paper)
    return Setting(
        id=name,
        label=label or "as measured",
        published_steps=full,
        budget_share=own / full if own is not None and full else None,
        trained_physics=key.trained,
        **{name: getattr(key, name) for name in _SHARED},
        axes={**dict(key.axes), **dict(key.other), **dict(key.scored_with)},
        changes_method=key.changes_method,
        notes=notes,
        matches_published=paper and not notes,
    )


def _notes(key: Key, paper: bool) -> list[str]:
    """Differences of a setting's games from the published ones."""
    notes, actions = [], (key.adversary_actions, key.victim_actions)
    if paper and (mark := budget_mark(key.steps, published().adversary_steps)):
        notes.append(f"Adversaries trained for {mark} of the published budget.")
    if key.physics not in (None, FAITHFUL):
        notes.append(f"Played in {key.physics} physics, not in the game as it was made.")
    elif key.trained not in (None, FAITHFUL):
        notes.append(f"Trained in {key.trained} physics, played in the game as it was made.")
    if key.victim == STUDENT:
        notes.append("The victims are students that ship with apil, not the agents of the papers.")
    elif key.victim != DEFAULT_VICTIM:
        notes.append(f"The victim is {key.victim}, not the agent of the papers.")
    if paper and set(actions) != {PUBLISHED_MODE}:
        notes.append(
            f"Actions are {_modes(*actions)} (adversary/victim); the published evaluation code takes the "
            "mode of both, and that alone can be worth ten points."
        )
    notes += [f"Not the defaults: {assignments(pairs)}." for pairs in (key.axes, key.other) if pairs]
    if key.scored_with:
        notes.append(f"The victims were defended in the games: {_defences(key)}.")
    return notes


def cell_marks(setting: Setting, game: str, scores: Sequence[SeedScore], *, trained: bool) -> list[str]:
    """Short warning labels of a cell; ``trained`` here, not an agent from elsewhere."""
    if not scores:
        return []
    marks = [setting.budget] if trained and setting.budget and in_paper([game]) else []
    if trained and len(scores) < ENOUGH_SEEDS:
        marks.append(several(len(scores), "seed"))
    least = min(score.episodes for score in scores)
    if least < published().episodes:
        marks.append(f"{least} games")
    if setting.physics not in (None, FAITHFUL):
        marks.append(f"{setting.physics} physics")
    if setting.victim != DEFAULT_VICTIM:
        marks.append("other victim" if setting.victim != STUDENT else STUDENT)
    return marks
