"""The rows of ``apil fidelity``: every matchup of every game, at its defaults and with one option switched.

Pure data in, pure data out: the switchable options are read from the game's option model and the matchup,
so third-party games get the same report.
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import NoneType
from typing import Any, Literal

from pydantic import BaseModel

from apil_core.api.config import ActionMode, EvaluationConfig
from apil_core.api.profiles import Profile, ProfiledOptions
from apil_core.api.specs import GameSpec, Matchup, PublishedScore, load
from apil_core.common.annotations import alternatives
from apil_core.common.documents import EXACT
from apil_core.common.errors import ConfigError, suggest
from apil_core.config.game import PHYSICS
from apil_core.evaluation.options import FidelityOptions
from apil_core.plugins.registry import options_model

_MODE_KEYS = ("adversary_actions", "victim_actions")
_MODES: tuple[ActionMode, ...] = ("sample", "mode")

RowKind = Literal["default", "as-published", "profile", "switch", "variant"]


class RowPlan(BaseModel):
    """One row before it is played.

    Attributes:
        env: the game.
        kind: the game's defaults, the published action modes, either of them in another physics profile,
            one switch of the defaults, or a variant the user asked for.
        options: the game's options that are not at their defaults.
        published: score to compare with.
        stands_in_for: the adversary ``published`` was measured with, if it is another one.
    """

    model_config = EXACT

    env: str
    adversary: str
    victim: str
    kind: RowKind
    adversary_actions: ActionMode
    victim_actions: ActionMode
    options: dict[str, Any] = {}
    episodes: int
    seed: int
    num_envs: int
    published: PublishedScore | None = None
    stands_in_for: str | None = None

    @property
    def identity(self) -> tuple[object, ...]:
        """Key among the rows, without the number of games and the seed."""
        options = tuple(sorted((key, repr(value)) for key, value in self.options.items()))
        return (self.env, self.adversary, self.victim, self.adversary_actions, self.victim_actions, options)

    @property
    def setting(self) -> str:
        """``sampled/mode, solver Newton``: the adversary's and the victim's actions, and switched options."""
        how = {"sample": "sampled", "mode": "mode"}
        parts = [f"{how[self.adversary_actions]}/{how[self.victim_actions]}"]
        parts += [f"{key} {value}" for key, value in self.options.items()]
        return ", ".join(parts)

    @property
    def title(self) -> str:
        """Game, both policies and setting."""
        return f"{self.env}, {self.adversary} against {self.victim}, {self.setting}"


class SkippedMatchup(BaseModel):
    """A matchup that cannot be played here, with the reason."""

    env: str
    adversary: str
    victim: str
    reason: str


@dataclass
class Plan:
    """Rows to play, the defaults first, and matchups that cannot be played."""

    rows: list[RowPlan] = field(default_factory=list)
    skipped: list[SkippedMatchup] = field(default_factory=list)


def plan_rows(
    games: Iterable[GameSpec], request: FidelityOptions, missing: Callable[[str], str | None]
) -> Plan:
    """Plan the rows: defaults of all games, then as published, then switches, then variants.

    Args:
        games: with the matchups to play.
        request: the user's.
        missing: returns the reason why a policy cannot be played here, by its name; ``None`` if it can.

    Raises:
        ConfigError: a variant fits no game, or a game's options refuse it.
    """
    games = list(games)
    _check_variants(request.variants, games)
    plan = Plan()
    playable: list[tuple[GameSpec, Matchup]] = []
    for spec in games:
        lacking = {name: missing(name) for m in spec.matchups for name in (m.adversary, m.victim)}
        for matchup in spec.matchups:
            reason = lacking[matchup.adversary] or lacking[matchup.victim]
            if reason is None and request.physics is not None:
                reason = no_profiles(spec)
            if reason is not None:
                facts = {"env": spec.name, "adversary": matchup.adversary, "victim": matchup.victim}
                plan.skipped.append(SkippedMatchup(**facts, reason=reason))
            elif matchup.stands_in_for is None or lacking.get(matchup.stands_in_for):
                playable.append((spec, matchup))
    unique: dict[tuple[object, ...], RowPlan] = {}
    for kind in typing.get_args(RowKind):
        for spec, matchup in playable:
            for row in _rows(kind, spec, matchup, request):
                unique.setdefault(row.identity, row)
    plan.rows = list(unique.values())
    return plan


def switches(model: type[BaseModel] | None, physics: Profile | None = None) -> list[dict[str, Any]]:
    """One switch at a time: the other action modes, then each other value of each flag and choice.

    Numbers are not switched: a model does not define other meaningful values.

    Args:
        model: the game's option model, or ``None``.
        physics: profile that the switches start from; ``None``: the game's default.
    """
    default = _default_modes()
    pairs = [dict(zip(_MODE_KEYS, (a, b), strict=True)) for a in _MODES for b in _MODES]
    found: list[dict[str, Any]] = [pair for pair in pairs if pair != default]
    start = _values(model, {} if physics is None else {PHYSICS: physics})
    for name, info in ({} if model is None else model.model_fields).items():
        found += [{name: value} for value in _choices(info.annotation) if value != start[name]]
    return found


def no_profiles(spec: GameSpec) -> str | None:
    """Reason why a game has no other physics profile; ``None`` if it has."""
    model = _model(spec)
    fine = model is not None and issubclass(model, ProfiledOptions)
    return None if fine else f"game {spec.name} has no physics profiles"


def _rows(kind: RowKind, spec: GameSpec, matchup: Matchup, request: FidelityOptions) -> Iterator[RowPlan]:
    model = _model(spec)
    base = _base(model, request.physics)
    changes: list[dict[str, Any]] = []
    if kind == ("profile" if base else "default"):
        changes.append({})
    if kind == ("profile" if base else "as-published") and matchup.published is not None:
        known = {key: getattr(matchup.published, key) for key in _MODE_KEYS}
        changes.append({key: mode for key, mode in known.items() if mode is not None})
    if kind == "switch" and request.switches:
        changes = switches(model, request.physics)
    if kind == "variant":
        changes = [dict(variant) for variant in request.variants if _fits(variant, model)]
    episodes = request.switch_episodes if kind in ("switch", "variant") else request.episodes
    for change in changes:
        modes = {key: change.pop(key, mode) for key, mode in _default_modes().items()}
        yield RowPlan(
            env=spec.name,
            adversary=matchup.adversary,
            victim=matchup.victim,
            kind=kind,
            **modes,
            options=_stored_options(model, {**base, **change}),
            episodes=episodes,
            seed=request.seed,
            num_envs=min(episodes, request.num_envs),
            published=matchup.published,
            stands_in_for=matchup.stands_in_for,
        )


def _default_modes() -> dict[str, ActionMode]:
    return EvaluationConfig().model_dump(include=set(_MODE_KEYS))


def _model(spec: GameSpec) -> type[BaseModel] | None:
    return None if spec.config is None else load(spec.config)


def _choices(annotation: Any) -> tuple[Any, ...]:
    """Values of a flag or a choice, ``None`` aside."""
    kinds = [kind for kind in alternatives(annotation) if kind is not NoneType]
    if kinds == [bool]:
        return (False, True)
    literal = len(kinds) == 1 and typing.get_origin(kinds[0]) is Literal
    return typing.get_args(kinds[0]) if literal else ()


def _values(model: type[BaseModel] | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Value of every option, the profile's where there are profiles."""
    if model is None:
        return {}
    made = model.model_validate(dict(options))
    return {**made.model_dump(), **(made.profile_values() if isinstance(made, ProfiledOptions) else {})}


def _base(model: type[BaseModel] | None, physics: Profile | None) -> dict[str, Any]:
    """The options that put a game into a profile other than its default."""
    return {} if physics is None else _stored_options(model, {PHYSICS: physics})


def _stored_options(model: type[BaseModel] | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options with an effect: neither a default nor the profile's value."""
    plain = _values(model, {})
    profile = {key: value for key, value in options.items() if key == PHYSICS and value != plain.get(key)}
    start = _values(model, profile)
    return {**profile, **{key: value for key, value in options.items() if start.get(key) != value}}


def _fits(variant: Mapping[str, Any], model: type[BaseModel] | None) -> bool:
    return variant.keys() - set(_MODE_KEYS) <= ({} if model is None else model.model_fields).keys()


def _check_variants(variants: Sequence[Mapping[str, Any]], games: Sequence[GameSpec]) -> None:
    """Check values before hours of games depend on them."""
    known = {*_MODE_KEYS}.union(*(m.model_fields for m in map(_model, games) if m is not None))
    for variant in variants:
        for key, value in variant.items():
            if key not in known:
                raise ConfigError(f"variant: unknown key {key!r}{suggest(key, known)}")
            if key in _MODE_KEYS and value not in _MODES:
                raise ConfigError(f"variant: {key} must be sample or mode, got {value!r}")
        fitting = [spec for spec in games if _fits(variant, _model(spec))]
        if games and not fitting:
            raise ConfigError(f"variant: no game has all of {', '.join(variant)}")
        for spec in fitting:
            options = {key: value for key, value in variant.items() if key not in _MODE_KEYS}
            options_model(spec.config, options, f"variant: game {spec.name}")
