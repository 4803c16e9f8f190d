"""Settings shared by the cells of one table: budget, physics, victim, action modes and others."""

from __future__ import annotations

from collections.abc import Container, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.api.specs import GameSpec
from apil_core.common.errors import ApilError
from apil_core.config.game import game_model, profile_keys
from apil_core.config.layers import flag_layer
from apil_core.config.resolve import differences, flatten, resolve_layers
from apil_core.evaluation.results import EvaluationResult, in_words, observers_played
from apil_core.plugins.defined import defined
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.studies.report.sources import Run

_FREE = (  # noqa: SIM905
    "method env victim victim_sha256 victim_side trust steps seed threads device recorders log_rows plugins "
    "version options game game.physics"
).split()
_FREE_SECTIONS = ("checkpoint.", "evaluation.", "options.")
"""Settings shown elsewhere, without effect on results, or specific to one method."""

DEFAULT_VICTIM, STUDENT = "default", "embedded student"


@dataclass(frozen=True)
class Key:
    """Settings shared by the cells of a block; see :class:`apil_core.studies.report.models.Setting`.

    Attributes:
        axes: key and value of the settings its benchmark varies, where they are not the default.
        other: key and value of further settings that differ from the defaults, for any method.
        observers: names of those the training had.
        scored_with: observers that were switched on for the scored games only, as name and options.
        retrain_steps: budget of the victims' retraining; ``None`` for victims as they were.
        variant: 0, or counts up where runs of one cell differ in something else still.
    """

    steps: int | None
    trained: str | None
    physics: str | None
    victim: str
    adversary_actions: str
    victim_actions: str
    axes: tuple[tuple[str, str], ...] = ()
    other: tuple[tuple[str, str], ...] = ()
    observers: tuple[str, ...] = ()
    scored_with: tuple[tuple[str, str], ...] = ()
    retrain_steps: int | None = None
    variant: int = 0

    @property
    def training(self) -> Key:
        """Training settings, which are the same for all scores of a run."""
        return replace(self, physics=None, adversary_actions="", victim_actions="", scored_with=())

    @property
    def changes_method(self) -> bool:
        """Return whether an option makes a method differ from the published one."""
        options = (name.split(".")[1] for name, _ in self.axes if name.startswith("options."))
        return any(owner not in self.observers for owner in options)


def key_of(run: Run, score: EvaluationResult | None) -> Key:
    """Key of a score of a run; without one, of the score the run itself would make."""
    config = run.config
    if score is None:
        actions = (config.evaluation.adversary_actions, config.evaluation.victim_actions)
        physics, victim = run.physics, run.dir.victim()
    else:
        actions = (score.adversary_actions, score.victim_actions)
        # old scores have no profile: they were played with the run's
        physics, victim = score.physics or run.physics, score.victim.name
    trained = score.trained_steps if score is not None else None
    played = {} if score is None else score.observers or {}
    default = default_config(config)
    stored = flatten(config.model_dump(mode="json"))
    usual = {} if default is None else flatten(default.model_dump(mode="json"))
    axes = {key: stored[key] for key in run.axes if key in stored and stored[key] != usual.get(key)}
    return Key(
        # a stopped run's score is one of a smaller budget
        steps=config.steps if trained is None else min(config.steps, trained),
        trained=run.physics,
        physics=physics,
        victim=victim_kind(config.env, victim, config.plugins),
        adversary_actions=actions[0],
        victim_actions=actions[1],
        axes=tuple((key, str(value)) for key, value in axes.items()),
        other=tuple((key, str(value)) for key, value in _other(config, default).items() if key not in axes),
        observers=config.observers,
        scored_with=_observed({name: o for name, o in played.items() if name not in config.observers}),
    )


def key_without_run(score: EvaluationResult) -> Key:
    """Key of a score in whose games no run was scored."""
    model = game_model(score.env, _plugins(())) if game_of(score.env) is not None else None
    fields, hidden = ({}, ()) if model is None else (model.model_fields, profile_keys(model))
    changed = {
        f"game.{key}": value
        for key, value in score.options_played.items()
        if key != "physics" and key not in hidden and not (key in fields and fields[key].default == value)
    }
    return Key(
        steps=None,
        trained=score.physics,
        physics=score.physics,
        victim=victim_kind(score.env, score.victim.name),
        adversary_actions=score.adversary_actions,
        victim_actions=score.victim_actions,
        other=tuple((key, str(value)) for key, value in changed.items()),
        scored_with=_observed(score.observers or {}),
    )


def _observed(observers: Mapping[str, Mapping[str, Any]]) -> tuple[tuple[str, str], ...]:
    return tuple(
        (f"scored with {name}", ", ".join(f"{key}={value}" for key, value in options.items()) or "on")
        for name, options in observers.items()
    )


def victim_kind(env: str, victim: str, plugins: Sequence[str] = ()) -> str:
    """``default``, ``embedded student`` or the policy's name; equal across games for the first two."""
    spec = game_of(env, plugins)
    if spec is None:
        return victim
    kinds = {spec.fallback_victim: STUDENT, spec.default_victim: DEFAULT_VICTIM}
    return kinds.get(victim, victim)


def game_of(env: str, plugins: Sequence[str] = ()) -> GameSpec | None:
    """Return the registered spec of a game; ``None`` if it is not installed."""
    try:
        return _plugins(tuple(plugins)).game(env)
    except ApilError:
        return None


def value_at(config: RunConfig, key: str) -> Any:
    """Return the value of a dotted key, or ``None``."""
    return flatten(config.model_dump(mode="json")).get(key)


def default_config(config: RunConfig) -> RunConfig | None:
    """Default configuration of a run of that method in that game; ``None`` if one is not installed."""
    return _default(config.method, config.env, config.plugins, _code_of(config.plugins))


@cache
def _default(method: str, env: str, plugins: tuple[str, ...], _: tuple[Hashable, ...]) -> RunConfig | None:
    try:
        return resolve_layers([flag_layer({"method": method, "env": env})], _plugins(plugins))
    except ApilError:
        return None


def _code_of(files: tuple[str, ...]) -> tuple[Hashable, ...]:
    """What plugins may change by within a process: the text of their files, and what is defined in it."""
    texts = (Path(file).read_bytes() if Path(file).is_file() else None for file in files)
    return *texts, *map(id, defined.values())  # no id returns: the registries in the cache keep the objects


def _plugins(files: tuple[str, ...]) -> PluginRegistry:
    return _discovered(files, _code_of(files))


@cache
def _discovered(files: tuple[str, ...], _: tuple[Hashable, ...]) -> PluginRegistry:
    return discover(files)


def _other(config: RunConfig, default: RunConfig | None) -> dict[str, Any]:
    if default is None:
        return {}
    hidden = {f"game.{key}" for key in profile_keys(game_model(config.env, _plugins(tuple(config.plugins))))}
    return {
        # an observer's options matter, and no default run has them
        key: ", ".join(in_words(observers_played(config))) if key == "observers" else value
        for key, (value, _) in differences(config, default).items()
        if key not in _FREE and not key.startswith(_FREE_SECTIONS) and key not in hidden
    }


def changed_options(config: RunConfig, besides: Container[str]) -> list[str]:
    """The method's options that differ from its defaults, ``key=value``, except some keys."""
    default = default_config(config)
    usual = {} if default is None else flatten(default.model_dump(mode="json"))
    return [
        f"{key}={value}"
        for key, value in flatten(config.model_dump(mode="json")).items()
        if key.startswith("options.") and key in usual and value != usual[key] and key not in besides
    ]


def conditions(score: EvaluationResult) -> tuple[Any, ...]:
    """All that a score depends on except the adversary, its blinding, the seed and the number of games."""
    actions = (score.adversary_actions, score.victim_actions)
    return score.env, score.victim, actions, score.options_played, score.observers or {}


def varying(texts: Iterable[Mapping[str, str]]) -> set[str]:
    """Names with different texts; every mapping has all names."""
    seen: dict[str, set[str]] = {}
    for name, text in (pair for facts in texts for pair in facts.items()):
        seen.setdefault(name, set()).add(text)
    return {name for name, found in seen.items() if len(found) > 1}
