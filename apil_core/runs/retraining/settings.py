"""Settings of a retraining: defaults, the runs' game and victim, flags, then ``--set`` texts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import create_model

from apil_core.api.config import PPOConfig, RunConfig
from apil_core.common.documents import plain
from apil_core.common.errors import ConfigError
from apil_core.config.game import game_model, profile_problems, settled
from apil_core.config.layers import POLICY_NAME, Layer, flag_layer, merge, set_layer
from apil_core.config.problems import Problem, raise_problems, validated
from apil_core.plugins.default_victim import BASELINES, default_victim
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import plugins_with
from apil_core.policies.loading import victim_name, victim_side
from apil_core.runs.retraining.config import MIXED, OF_THE_VICTIM, RetrainConfig
from apil_core.training.export.run_policy import SCHEME, RunCheckpoint, run_path

BASELINE = "baseline"
"""Label of the adversary that the victim already knows."""


def settings(
    adversaries: Sequence[Path | str],
    flags: Mapping[str, Any] | None = None,
    sets: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
    plugin_files: Sequence[Path | str] = (),
) -> RetrainConfig:
    """Return the complete settings of a retraining.

    Game, its physics and the victim are the first run's unless given. PPO and the number of games are not:
    settings with which an adversary learns from nothing can undo what a victim knows (docs/retraining.md).

    Args:
        adversaries: run directories, ``run:DIR`` or checkpoints of runs, or (besides one of these, or
            with ``env`` and ``victim`` among the flags) names of policies.
        flags: values by setting; ``game.physics`` for the profile.
        sets: ``KEY=VALUE`` texts.
        plugins: registry of games and methods; default: the installed ones, and the one-file plugins.
        plugin_files: one-file plugins besides those that the runs name.

    Raises:
        ApilError: no such run, or one line per mistake.
    """
    sources = {str(name): _source(name) for name in adversaries}
    if len(sources) < len(adversaries):
        raise ConfigError("an adversary is named twice")
    runs = {name: source.run_dir.config() for name, source in sources.items() if source is not None}
    given = [str(Path(file).absolute()) for file in plugin_files]
    files = tuple(dict.fromkeys([*(file for run in runs.values() for file in run.plugins), *given]))
    plugins = plugins or plugins_with(files)
    flags = {key: value for key, value in (flags or {}).items() if value is not None}
    base = {
        **_from_runs(runs, plugins, victim_given="victim" in flags),
        "adversaries": [
            str(name) if source is None else f"{SCHEME}{source.path}" for name, source in sources.items()
        ],
        "labels": _labels(sources, runs),
        "plugins": files,
    }
    return _checked(base, [flag_layer(flags), *map(set_layer, sets)], plugins)


def _source(name: Path | str) -> RunCheckpoint | None:
    path, text = run_path(name), str(name)
    is_policy = text in BASELINES or POLICY_NAME.match(text) is not None
    if path is None and not is_policy and text.endswith(".pt"):
        path = Path(name)
    if path is None and not is_policy:
        raise ConfigError(f"{name} is neither a run directory nor a policy name like zoo:GAME/ROLE/v1")
    return None if path is None else RunCheckpoint.find(path)


def _from_runs(
    runs: Mapping[str, RunConfig], plugins: PluginRegistry, *, victim_given: bool
) -> dict[str, Any]:
    """Settings fixed by the first run.

    Raises:
        ConfigError: the runs are of different games, or attacked different victims.
    """
    if not runs:
        return {}
    (first, config), *others = runs.items()
    victims = {name: victim_name(run, plugins) for name, run in runs.items()}
    for name, run in others:
        if run.env != config.env:
            raise ConfigError(f"{name} was trained on {run.env}, {first} on {config.env}: one game at a time")
        if victims[name] != victims[first] and not victim_given:
            raise ConfigError(
                f"{first} attacked {victims[first]}, and {name} {victims[name]}: "
                "say with --victim which one to harden"
            )
    found = {
        "env": config.env,
        "victim": victims[first],
        "victim_side": victim_side(config, plugins),
        "game": config.game,
    }
    if not victim_given:  # the attacked one, not another with its name
        found["victim_sha256"] = config.victim_sha256
    return found


def _labels(sources: Mapping[str, RunCheckpoint | None], runs: Mapping[str, RunConfig]) -> list[str]:
    """A run's method, another policy's name or its file's stem; numbered where they repeat."""
    plain = [runs[name].method if name in runs else _short(name) for name in sources]
    counts = Counter((BASELINE, MIXED))
    labels = []
    for label in plain:
        counts[label] += 1
        labels.append(label if counts[label] == 1 else f"{label}-{counts[label]}")
    return [*labels, BASELINE]


def _short(policy: str) -> str:
    """A policy's short name without slashes, as it becomes part of metric names."""
    rest = Path(policy.partition(":")[2])
    return rest.stem if rest.suffix else policy.replace("/", "-")


def _checked(base: dict[str, Any], asked: Sequence[Layer], plugins: PluginRegistry) -> RetrainConfig:
    env = merge(base, asked)[0].get("env")
    if env is None:
        raise ConfigError("say which game the adversaries play: --env GAME")
    if base.get("env") not in (None, env):
        raise ConfigError(f"the adversaries were trained on {base['env']}; they cannot play {env}")
    spec, options = plugins.game(env), game_model(env, plugins)
    layers = settled([Layer({"game": base.get("game", {})}), *asked], options)
    own = {"victim": default_victim(spec, plugins), "victim_side": spec.victim_side, **base, "game": {}}
    data, origins = merge(own, layers)
    raise_problems(profile_problems(data, options, env), origins)
    model = create_model("RetrainSettings", __base__=RetrainConfig, game=(options, ...))
    found = RetrainConfig.model_validate(plain(validated(model, data, origins)))
    given, usual = (ppo.model_dump(include=set(OF_THE_VICTIM)) for ppo in (found.ppo, PPOConfig()))
    reason = "is no setting of a retraining: the victim has its own"
    raise_problems([Problem(("ppo", key), reason) for key in usual if given[key] != usual[key]], origins)
    return found
