"""Assembling a run's parts from its configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch

from apil_core.api.config import RunConfig
from apil_core.api.game import Game, GameLayout
from apil_core.api.method import Method, MethodSetup, Observer, RunPlugin
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Context
from apil_core.common.errors import ConfigError, PluginError
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import build_methods, build_observers, game_spec, make_game
from apil_core.policies.loading import pinned, run_victim, victim_side
from apil_core.training.adversary import HOOK_STREAM, AdversaryPolicy, ObservationBuilder
from apil_core.training.attack_env import AttackEnv
from apil_core.training.distributed.world import ALONE, World
from apil_core.training.plugin_state import check_states, load_states
from apil_core.training.ppo import Actor, Learner
from apil_core.training.rewards import resolve_weights
from apil_core.training.white_box import check_differentiable


@dataclass
class RunParts:
    """The parts of a run, wired together."""

    config: RunConfig
    game: Game
    victim: Policy
    adversary_side: int
    methods: dict[str, Method]
    hooks: RunHookManager
    builder: ObservationBuilder
    generators: dict[str, torch.Generator]
    env: AttackEnv
    learner: Learner
    world: World


def check_device(name: str) -> torch.device:
    """The torch device of that name.

    Raises:
        ConfigError: no such device here.
    """
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f"device: {name!r} is no device; use cpu, cuda or cuda:N") from error
    if device.type == "cuda" and not torch.cuda.is_available():
        raise ConfigError(f"device: {name!r} asked for, but torch sees no CUDA GPU here; use --device cpu")
    if device.type not in ("cpu", "cuda"):
        raise ConfigError(f"device: {name!r} is not supported; use cpu, cuda or cuda:N")
    return device


def build_hooks(
    config: RunConfig,
    plugins: PluginRegistry,
    setup: MethodSetup,
    manager: type[RunHookManager] = RunHookManager,
) -> tuple[dict[str, Method], RunHookManager]:
    """The run's methods and the manager that holds them and the observers."""
    chain = plugins.method_chain(config.method)
    methods = build_methods(chain, config.options, setup)
    observers = observing(config, plugins, replace(setup, methods=methods))
    for name in observers:
        if name in methods:
            raise PluginError(f"observers: {name!r} is already part of method {config.method!r}")
    hooks = manager(chain, {**methods, **observers, **plugins.watchers})
    hooks.device = setup.device
    return methods, hooks


def observing(config: RunConfig, plugins: PluginRegistry, setup: MethodSetup) -> dict[str, Any]:
    """Build ``config.observers``, in that order: new objects, or plugin modules.

    Raises:
        ConfigError: there is none of a name.
        PluginError: one cannot be built.
    """
    known = plugins.observer_names()
    for name in config.observers:
        if name not in known:
            raise ConfigError(f"observers: {name!r} is no observer here; apil observers lists them")
    registered = [plugins.observers[name] for name in config.observers if name in plugins.observers]
    built = build_observers(registered, config.options, setup)
    return {name: built[name] if name in built else plugins.modules[name] for name in config.observers}


def observing_alone(
    config: RunConfig, layout: GameLayout, side: int, plugins: PluginRegistry
) -> RunHookManager | None:
    """Hooks of ``config.observers`` for a policy that no run trained; ``None`` if there are none.

    Args:
        side: the adversary's.
    """
    if not config.observers:
        return None
    setup = method_setup(config, layout, side, torch.device(config.device))
    hooks = RunHookManager((), observing(config, plugins, setup))
    hooks.device = setup.device
    return hooks


def generators(seed: int, device: torch.device) -> dict[str, torch.Generator]:
    """Independent streams for the victim's actions and the methods' draws."""
    return {name: stream_generator(seed, f"training {name}", device) for name in ("victim", "method")}


@one_torch_thread()
def build(
    config: RunConfig,
    plugins: PluginRegistry,
    manager: type[RunHookManager] = RunHookManager,
    world: World = ALONE,
) -> RunParts:
    """Build all objects of a run; seeds torch's global generator, which PPO draws from.

    Args:
        config: the run's.
        plugins: registry with the names in the config.
        manager: of the run's hooks; ``benchmarks/speed`` passes one that times them.
        world: processes that train together: each has its own games and random streams, and equal networks.

    Raises:
        ApilError: names, options, weights or plugins are wrong.
    """
    config = config.model_copy(update={"device": world.device(config.device)})
    device = check_device(config.device)
    seed = world.seed(config.seed)
    spec = game_spec(config.env, plugins)
    torch.manual_seed(config.seed)
    game = seeded_games(config, plugins, world, "training games")
    attacked = victim_side(config, plugins)
    victim = run_victim(config, game, plugins, seed)
    config = pinned(config, victim)
    setup = method_setup(config, game.layout, 1 - attacked, device)
    methods, hooks = build_hooks(config, plugins, setup, manager)
    if hooks.white_box:
        check_differentiable(victim, game.layout, attacked, device)
    check_states(hooks.of(RunPlugin), lambda: build_hooks(config, plugins, setup)[1].of(RunPlugin), device)
    builder = ObservationBuilder(hooks, config.ppo.observation_clip)
    streams = generators(seed, device)
    env = AttackEnv(
        game,
        victim,
        builder,
        hooks,
        config,
        weights=resolve_weights(config.reward, spec.rewards),
        adversary_side=1 - attacked,
        generators=streams,
    )
    env.keeps_victim_states = hooks.white_box
    with hooks.attribution():
        example = env.get_observations()
    seat = game.layout.sides[1 - attacked]
    actor = Actor(builder.sizes, seat.action_size, config.ppo, seat.action_limit)
    learner = Learner(actor, example, env.buffer, config.ppo, device, world, game.layout.max_steps)
    if not world.is_main:  # the networks exist: from here on each process draws its own random numbers
        torch.manual_seed(seed)
    return RunParts(config, game, victim, 1 - attacked, methods, hooks, builder, streams, env, learner, world)


def seeded_games(config: RunConfig, plugins: PluginRegistry, world: World, stream: str) -> Game:
    """This process's games of a run, which draw from the random stream of that name."""
    game = make_game(
        config.env,
        num_envs=config.num_envs,
        threads=world.threads(config.threads),
        options=config.game,
        plugins=plugins,
    )
    game.seed(stream_seed(world.seed(config.seed), stream))
    return game


def method_setup(
    config: RunConfig, layout: GameLayout, adversary_side: int, device: torch.device
) -> MethodSetup:
    """Argument of the methods' constructors."""
    return MethodSetup(
        layout=layout,
        adversary_side=adversary_side,
        device=device,
        seed=config.seed,
        ppo=config.ppo,
        methods={},
    )


def adversary_policy(
    state: Mapping[str, Any],
    info: PolicyInfo,
    config: RunConfig,
    layout: GameLayout,
    side: int,
    plugins: PluginRegistry,
    seed: int,
) -> AdversaryPolicy:
    """The adversary of a checkpoint's ``state``, without its run.

    Args:
        side: the seat it was trained for.
        seed: of the generator its stochastic hooks draw from.
    """
    device = torch.device(config.device)
    methods, hooks = build_hooks(config, plugins, method_setup(config, layout, side, device))
    load_states(methods, state["methods"])
    trained_with = state.get("config", {}).get("observers", ())  # others are switched on for this use only
    kept, observers = state.get("observers", {}), hooks.of(Observer)
    load_states({name: o for name, o in observers.items() if name in kept or name in trained_with}, kept)
    builder = ObservationBuilder(hooks, config.ppo.observation_clip)
    sizes: dict[str, int] = state["groups"]
    builder.add_normalizers(sizes, device)
    builder.load_state_dict(state["builder"])
    seat = layout.sides[side]
    actor = Actor(sizes, seat.action_size, config.ppo, seat.action_limit).to(device)
    actor.model.load_state_dict(state["learner"]["ppo"]["actor_state_dict"])
    context = Context(
        side=side,
        role="adversary",
        seat=seat,
        mode="eval",
        device=device,
        generator=stream_generator(seed, HOOK_STREAM, device),
    )
    return AdversaryPolicy(info, builder, actor, context, hooks)
