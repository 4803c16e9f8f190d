"""What is to be measured: from names on the command line to settings, all checked before anything runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.api.specs import load
from apil_core.common.errors import ConfigError, UnknownNameError
from apil_core.common.machine import usable_cpus
from apil_core.config.resolve import resolve
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import options_model
from apil_core.policies.seats import victim_name
from apil_core.studies.speed.report import LEVELS, Level

ALL = "all"
"""Stands for every game that has a victim."""

PROFILE = "physics"
"""The game option that names a profile."""

_FOR_EVER = 10**9


@dataclass(frozen=True)
class SpeedRequest:
    """What to measure; the cells are all combinations.

    Attributes:
        envs: games, or :data:`ALL`.
        methods: of training.
        presets: settings of the trainings, besides the default ones.
        num_envs: games stepped together; empty: as the settings have it.
        threads: of the physics; 0: all CPUs.
        levels: which are reported; physics always is, where it can be timed.
        physics: profiles; empty: the games' own.
        victim: under attack, or ``auto``.
        batch: environment steps of a block, and PPO's batch; None: the settings' own.
        seconds: to spend on a cell.
        trust: the victim may run code of the user's.
    """

    envs: Sequence[str] = ("kick-and-defend",)
    methods: Sequence[str] = ("adrl", "e_apil")
    presets: Sequence[str] = ()
    num_envs: Sequence[int] = ()
    threads: Sequence[int] = (0,)
    levels: Sequence[str] = LEVELS
    physics: Sequence[str] = ()
    victim: str = "auto"
    batch: int | None = None
    seconds: float = 300.0
    trust: bool = False


@dataclass(frozen=True)
class CellPlan:
    """One setting.

    Attributes:
        configs: of the training of every method.
        levels: to report.
        seconds: to spend on it.
    """

    configs: dict[str, RunConfig]
    levels: tuple[Level, ...]
    seconds: float
    any_config: RunConfig = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "any_config", next(iter(self.configs.values())))

    def __str__(self) -> str:
        config = self.any_config
        profile = config.game.get(PROFILE)
        game = f"{config.env} ({profile})" if profile else config.env
        return f"{game}, {config.num_envs} games, {config.threads} thread{'s' * (config.threads != 1)}"


def make_plan(request: SpeedRequest, plugins: PluginRegistry) -> list[CellPlan]:
    """The cells of a request, in order.

    Raises:
        ApilError: a name is unknown, or a number makes no sense.
    """
    if not request.seconds > 0:
        raise ConfigError(f"--seconds: {request.seconds:g} is not above 0")
    levels = tuple(level for level in LEVELS if level in _known(request.levels))
    methods = dict.fromkeys(request.methods)
    for method in methods:
        plugins.method_chain(method)
    base = resolve(presets=request.presets, plugins=plugins)
    batch = request.batch or base.num_envs * base.ppo.num_steps
    sizes = list(product(dict.fromkeys(request.num_envs or [base.num_envs]), dict.fromkeys(request.threads)))
    cells = [
        CellPlan(
            {
                method: _config(request, plugins, batch, *size, {"method": method, "env": env, **game})
                for method in methods
            },
            levels,
            request.seconds,
        )
        for env in dict.fromkeys(_games(request.envs, plugins))
        for game in _options(env, request, plugins)
        for size in sizes
    ]
    for cell in cells:
        victim_name(cell.any_config, plugins)
    return cells


def _known(levels: Iterable[str]) -> set[str]:
    for level in levels:
        if level not in LEVELS:
            raise UnknownNameError("level", level, LEVELS)
    return set(levels)


def _games(names: Sequence[str], plugins: PluginRegistry) -> list[str]:
    if ALL in names:
        return [name for name, spec in plugins.games.items() if spec.default_victim and not spec.family]
    return [plugins.game(name).name for name in names]


def _options(env: str, request: SpeedRequest, plugins: PluginRegistry) -> list[dict[str, Any]]:
    """Settings of the game for each profile; without profiles it has its turn once if all games are meant.

    Raises:
        ConfigError: it was named and has no profiles, or not these.
    """
    if not request.physics:
        return [{}]
    reference = plugins.game(env).config
    if reference is None or PROFILE not in load(reference).model_fields:
        if ALL in request.envs:
            return [{}]
        raise ConfigError(f"game {env!r} has no physics profiles; leave out --physics")
    profiles = dict.fromkeys(request.physics)
    for profile in profiles:
        options_model(reference, {PROFILE: profile}, f"game {env}")
    return [{f"game.{PROFILE}": profile} for profile in profiles]


def _config(
    request: SpeedRequest,
    plugins: PluginRegistry,
    batch: int,
    num_envs: int,
    threads: int,
    settings: dict[str, Any],
) -> RunConfig:
    """A training's configuration.

    Raises:
        ConfigError: the numbers make no run.
    """
    for name, value, least in (("--num-envs", num_envs, 1), ("--threads", threads, 0)):
        if value < least:
            raise ConfigError(f"{name}: {value} is less than {least}")
    if batch % num_envs or batch < num_envs:
        raise ConfigError(f"--batch {batch} is no multiple of {num_envs} games")
    flags = settings | {
        "victim": request.victim,
        "trust": request.trust,
        "num_envs": num_envs,
        "threads": threads or usable_cpus(),
        "steps": _FOR_EVER,
        "ppo.num_steps": batch // num_envs,
    }
    return resolve(presets=request.presets, flags=flags, plugins=plugins)
