"""From names to objects: games, policies and methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

from apil_core.api.game import Game, GameLayout, SideLayout
from apil_core.api.specs import (
    GameSpec,
    MethodSpec,
    ObserverSpec,
    Reference,
    RunPluginSpec,
    load,
    titled,
    wanted_of,
)
from apil_core.common.errors import (
    ApilError,
    ConfigError,
    PluginError,
    UnknownNameError,
    VictimError,
    failures,
)
from apil_core.common.trust import check
from apil_core.plugins.defined import defined
from apil_core.plugins.discovery import PluginRegistry, discover

if TYPE_CHECKING:
    from pydantic import BaseModel

    from apil_core.api.method import Method, MethodSetup, Observer
    from apil_core.api.policy import Policy

_default: tuple[PluginRegistry, dict[str, Any]] | None = None


def default_plugins() -> PluginRegistry:
    """The installed plugins and this process's, found once until another is defined."""
    global _default
    if _default is None or _default[1] != defined:
        _default = discover(), dict(defined)
    return _default[0]


def plugins_with(files: Sequence[str]) -> PluginRegistry:
    """The installed plugins and those of one-file plugins; each file counts once.

    Raises:
        PluginError: a file is broken.
    """
    return discover(list(dict.fromkeys(files))) if files else default_plugins()


def game_spec(name: str, plugins: PluginRegistry | None = None) -> GameSpec:
    """The game of that name.

    Raises:
        UnknownNameError: there is none.
    """
    return (plugins or default_plugins()).game(name)


def options_model(reference: Reference | None, values: Mapping[str, Any], where: str) -> BaseModel | None:
    """Validate ``values`` with the pydantic model a spec names.

    Raises:
        ConfigError: values for something that has no options, or values its model refuses.
    """
    from pydantic import ValidationError

    if reference is None:
        if values:
            raise ConfigError(f"{where} has no options, got {', '.join(sorted(values))}")
        return None
    try:
        return load(reference).model_validate(dict(values))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{where}: {key}: {first['msg']}") from error


def make_game(
    name: str,
    *,
    num_envs: int,
    threads: int = 1,
    options: dict[str, Any] | None = None,
    plugins: PluginRegistry | None = None,
) -> Game:
    """Build ``num_envs`` games of that name, stepped on ``threads`` threads (0: all CPUs).

    Raises:
        UnknownNameError: there is no such game.
        ConfigError: its options are wrong.
    """
    spec = game_spec(name, plugins)
    if name not in (plugins or default_plugins()).games:  # of a family: the name contains the callable
        check(name)
    model = options_model(spec.config, options or {}, f"game {name}")
    which = {"target": spec.target} if spec.target else {}
    game: Game = load(spec.factory)(num_envs=num_envs, threads=threads, options=model, **which)
    return game


def layout_of(
    name: str, options: dict[str, Any] | None = None, plugins: PluginRegistry | None = None
) -> GameLayout:
    """Layout of the games of that name; raises as :func:`make_game`."""
    with closing(make_game(name, num_envs=1, options=options, plugins=plugins)) as game:
        return game.layout


def named_side(env: str, side: str | None, plugins: PluginRegistry) -> tuple[GameLayout, int]:
    """Layout of a game, and the index of its side of that name; ``None``: the attacked one.

    Raises:
        UnknownNameError: there is no such game, or it has no such side.
    """
    layout = layout_of(env, plugins=plugins)
    names = [seat.name for seat in layout.sides]
    if side is None:
        return layout, game_spec(env, plugins).victim_side
    if side not in names:
        raise UnknownNameError(f"side of {env}", side, names)
    return layout, names.index(side)


def load_policy(
    name: str,
    *,
    device: str = "cpu",
    plugins: PluginRegistry | None = None,
    seat: SideLayout | None = None,
    trust: bool = False,
) -> Policy:
    """Load a policy by its full name, e.g. ``"zoo:kick-and-defend/kicker/v1"``.

    Args:
        name: scheme, colon, and the part that the scheme's loader reads.
        device: of the policy.
        plugins: registry with the schemes; default: the installed plugins.
        seat: of the policy; required by formats that do not state their own sizes.
        trust: allow names whose loading runs user code.

    Raises:
        UnknownNameError: no plugin registers the scheme.
        VictimError: the weights are missing or damaged; or loading would run code and ``trust`` is false.
    """
    registry = plugins or default_plugins()
    scheme, colon, rest = name.partition(":")
    if not colon or scheme not in registry.policies:
        known = [f"{s}:…" for s in registry.policies]
        raise UnknownNameError("policy", name, known)
    spec = registry.policies[scheme]
    if spec.runs_code:
        check(name, trust, VictimError)
    extras: dict[str, Any] = {"seat": seat} if spec.seat else {}
    if spec.plugins:
        extras |= {"plugins": registry, "device": device}
    policy: Policy = load(spec.loader)(rest, **extras)
    return policy.to(device)


def build_methods(
    chain: Sequence[MethodSpec], options: Mapping[str, Mapping[str, Any]], setup: MethodSetup
) -> dict[str, Method]:
    """Build the method objects of a run in ``requires`` order; each is added to ``setup.methods``.

    Raises:
        PluginError: a factory fails or gives something that is no ``Method``.
    """
    from dataclasses import replace

    from apil_core.api.method import Method

    built: dict[str, Method] = {}
    for spec in chain:
        made = _made(spec, options, replace(setup, methods=dict(built)))
        if not isinstance(made, Method):
            raise _no(spec, made)
        built[spec.name] = made
    return built


def build_observers(
    specs: Sequence[ObserverSpec], options: Mapping[str, Mapping[str, Any]], setup: MethodSetup
) -> dict[str, Observer]:
    """Make the observer objects of a run; all get the same ``setup``.

    Each draws its initial weights from its own random stream, so that they are the same in every run and no
    other plugin's weights change with it.

    Raises:
        PluginError: a factory fails or returns something that is no ``Observer``.
    """
    import torch

    from apil_core.api.method import Observer
    from apil_core.common.seeds import stream_seed, undisturbed

    built: dict[str, Observer] = {}
    for spec in specs:
        with undisturbed(setup.device):
            torch.manual_seed(stream_seed(setup.seed, f"observer {spec.name}"))
            made = _made(spec, options, setup)
        if not isinstance(made, Observer):
            raise _no(spec, made)
        built[spec.name] = made
    return built


def _made(spec: RunPluginSpec, options: Mapping[str, Mapping[str, Any]], setup: MethodSetup) -> object:
    model = options_model(spec.config, options.get(spec.name, {}), f"options.{spec.name}")
    factory = load(spec.factory, titled(spec))
    try:
        return factory(model, setup)
    except ApilError:
        raise
    except failures() as error:
        reason = " ".join(str(error).split())
        raise PluginError(
            f"plugin {spec.name!r} cannot be built: {type(error).__name__}: {reason}"
        ) from error


def _no(spec: RunPluginSpec, made: object) -> PluginError:
    got = type(made).__name__
    return PluginError(f"plugin {spec.name!r}: {spec.factory} must give {wanted_of(spec)}, got {got}")
