"""The measurement plan: names on the command line resolved to settings, checked before anything runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Annotated, Any

from cyclopts import Group, Parameter

from apil_core.api.config import RunConfig
from apil_core.api.specs import load
from apil_core.common.errors import ConfigError, UnknownNameError
from apil_core.common.machine import usable_cpus
from apil_core.config.layers import preset_names
from apil_core.config.resolve import resolve
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import options_model

from .report import LEVELS, Level

ALL = "all"
"""Name for all games that have a victim."""

PROFILE = "physics"
"""The game option that names a profile."""

_FOR_EVER = 10**9


_WHAT = Group("What to measure: every combination of", sort_key=0)
_HOW = Group("How", sort_key=1)


def _listed(_: Any, tokens: Any) -> tuple[str, ...]:
    """Split comma-separated names, in one flag or several."""
    words = [word.strip() for token in tokens for word in token.value.split(",")]
    if not all(words):
        raise ValueError("an empty word between commas")
    return tuple(words)


def _numbers(_: Any, tokens: Any) -> tuple[int, ...]:
    return tuple(int(word) for word in _listed(_, tokens))


def _words(text: str, **options: Any) -> Parameter:
    return Parameter(
        help=text, **{"group": _WHAT, "converter": _listed, "negative": (), "show_default": False, **options}
    )


def _number(text: str, **options: Any) -> Parameter:
    return _words(text, converter=_numbers, metavar="N,…", **options)


@Parameter(name="*")
@dataclass(frozen=True)
class SpeedRequest:
    """The settings to measure; the cells are all combinations. The command's flags are made from it.

    Attributes:
        env: games, or :data:`ALL`.
        methods: of training.
        num_envs: games stepped together; empty: as the settings have it.
        threads: of the physics; 0: all CPUs.
        physics: profiles; empty: the games' own.
        levels: which are reported; physics always is, where it can be timed.
        preset: settings of the trainings, besides the default ones.
        victim: under attack, or ``auto``; it may run code of the user's.
        seconds: to spend on a cell.
        batch: environment steps of a block, and PPO's batch; None: the settings' own.
    """

    env: Annotated[
        tuple[str, ...], _words("Games, or all [default: kick-and-defend].", alias="-e", metavar="GAME,…")
    ] = ("kick-and-defend",)
    methods: Annotated[
        tuple[str, ...],
        _words("Methods whose training is measured [default: adrl,e_apil].", alias="-m", metavar="NAME,…"),
    ] = ("adrl", "e_apil")
    num_envs: Annotated[
        tuple[int, ...],
        _number("Games stepped together, e.g. 16,64,128,256,512 [default: as the settings have it]."),
    ] = ()
    threads: Annotated[tuple[int, ...], _number("Physics threads; 0: all CPUs [default: 0].")] = (0,)
    physics: Annotated[
        tuple[str, ...],
        _words(
            "Physics profiles of the games: faithful, fast [default: the games' own].",
            metavar="PROFILE,…",
        ),
    ] = ()
    levels: Annotated[
        tuple[str, ...],
        _words(
            f"Only these: {', '.join(LEVELS)} [default: all].",
            group=_HOW,
            metavar="LEVEL,…",
        ),
    ] = LEVELS
    preset: Annotated[
        tuple[str, ...],
        Parameter(
            help=f"Settings of the trainings: {', '.join(preset_names())}; repeatable.",
            group=_HOW,
            negative=(),
            metavar="NAME",
            show_default=False,
        ),
    ] = ()
    victim: Annotated[str, Parameter(help="Policy under attack; auto: the game's.", group=_HOW)] = "auto"
    seconds: Annotated[
        float, Parameter(help="Time for each setting; at least three rounds are made.", group=_HOW)
    ] = 300.0
    batch: Annotated[
        int | None,
        Parameter(
            help="Environment steps of a block, which are PPO's batch [default: as the settings have it].",
            group=_HOW,
        ),
    ] = None


@dataclass(frozen=True)
class CellPlan:
    """One setting to measure.

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
    """Make the cells of a request, in order.

    Raises:
        ApilError: a name is unknown, or a number makes no sense.
    """
    if not request.seconds > 0:
        raise ConfigError(f"--seconds: {request.seconds:g} is not above 0")
    levels = tuple(level for level in LEVELS if level in _known(request.levels))
    methods = dict.fromkeys(request.methods)
    for method in methods:
        plugins.method_chain(method)
    base = resolve(presets=request.preset, plugins=plugins)
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
        for env in dict.fromkeys(_games(request.env, plugins))
        for game in _options(env, request, plugins)
        for size in sizes
    ]
    from apil_core.policies.loading import victim_name  # imports torch, as --help need not

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
    """Game options for each profile; a game without profiles is measured once if all games are requested.

    Raises:
        ConfigError: it was named and has no profiles, or not these.
    """
    if not request.physics:
        return [{}]
    reference = plugins.game(env).config
    if reference is None or PROFILE not in load(reference).model_fields:
        if ALL in request.env:
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
    """Make a training's configuration.

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
        "trust": True,
        "num_envs": num_envs,
        "threads": threads or usable_cpus(),
        "steps": _FOR_EVER,
        "ppo.num_steps": batch // num_envs,
    }
    return resolve(presets=request.preset, flags=flags, plugins=plugins)
