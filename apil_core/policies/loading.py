"""Loading of policies for a game's seats: from a name to a policy of the right sizes, checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from apil_core.api.config import RunConfig
from apil_core.api.game import Game, SideLayout
from apil_core.api.policy import Policy
from apil_core.common.errors import ConfigError, VictimError
from apil_core.common.seeds import stream_seed
from apil_core.config.kind import is_retraining
from apil_core.plugins.default_victim import BASELINES as BASELINES
from apil_core.plugins.default_victim import default_victim
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import game_spec, layout_of, load_policy
from apil_core.policies.conformance import check_policy


def victim_name(config: RunConfig, plugins: PluginRegistry) -> str:
    """The victim's full name, ``auto`` resolved to the game's default.

    Raises:
        ConfigError: the game has none.
    """
    if config.victim != "auto":
        return config.victim
    spec = game_spec(config.env, plugins)
    if not spec.default_victim:
        seat = layout_of(config.env, config.game, plugins).sides[victim_side(config, plugins)]
        raise ConfigError(
            f"game {config.env!r} has no default victim; name one for its {seat.name} "
            f"({seat.observation_size} observations, {seat.action_size} actions) with --victim NAME, or try "
            "`--victim zero` (does nothing) or `--victim random` (noise)"
        )
    return default_victim(spec, plugins)


def victim_side(config: RunConfig, plugins: PluginRegistry) -> int:
    """Index of the attacked side."""
    spec = game_spec(config.env, plugins)
    return spec.victim_side if config.victim_side is None else config.victim_side


def full_name(name: str, seat: SideLayout) -> str:
    """Full name of a short one in that seat: a baseline of its sizes, or the policy in a directory."""
    if name in BASELINES:
        return f"baseline:{name}/{seat.observation_size}x{seat.action_size}"
    if is_retraining(Path(name)):
        return f"retrained:{name}"
    return f"run:{name}" if Path(name).is_dir() else name


@dataclass(frozen=True)
class LoadOptions:
    """Options of loading a policy for a seat.

    Attributes:
        trust: allow names whose loading runs user code.
        seed: of the policy's own random generators.
        second: it acts after its opponent, and may read its opponent's action.
    """

    trust: bool = False
    seed: int = 0
    second: bool = False


def load_victim(
    name: str,
    game: Game,
    side: int,
    device: str,
    plugins: PluginRegistry,
    load_options: LoadOptions = LoadOptions(),
) -> Policy:
    """Load a policy for that seat and check that it fits.

    Args:
        name: a policy's, a run's directory, or one of :data:`BASELINES`.
        game: that has the seat; not stepped.
        side: index of the seat.
        device: of the networks.
        plugins: registry with the scheme.
        load_options: trust, seed and order.

    Raises:
        ConfigError: its sizes are not the seat's.
        VictimError: it cannot be loaded, or violates the policy interface.
    """
    seat = game.layout.sides[side]
    name = full_name(name, seat)
    policy = load_policy(name, device=device, plugins=plugins, seat=seat, trust=load_options.trust)
    info = policy.info
    if (info.observation_size, info.action_size) != (seat.observation_size, seat.action_size):
        raise ConfigError(
            f"{name} takes {info.observation_size} observations and gives {info.action_size} actions, "
            f"but the {seat.name} has {seat.observation_size} and {seat.action_size}"
        )
    policy.seed(load_options.seed)
    other = game.layout.sides[1 - side]
    check_policy(policy, seat, other, second=load_options.second, device=device)
    return policy


def run_victim(config: RunConfig, game: Game, plugins: PluginRegistry, seed: int) -> Policy:
    """Load the victim of a run; its weights must be those the run started with.

    Args:
        config: the run's.
        game: that has the victim's seat.
        plugins: registry with the victim's scheme.
        seed: of the victim's own random generators.

    Raises:
        VictimError: the weights have changed since, or cannot be loaded.
    """
    load_options = LoadOptions(
        config.trust, stream_seed(seed, "victim's hooks")
    )  # not the adversary's stream
    name = victim_name(config, plugins)
    policy = load_victim(name, game, victim_side(config, plugins), config.device, plugins, load_options)
    expected, found = config.victim_sha256, policy.info.sha256
    if expected not in ("", found):
        raise VictimError(
            f"{name} has changed since the run began: SHA-256 {found}, expected {expected}; put the old one "
            "back, or score against another with --victim"
        )
    return policy


def pinned(config: RunConfig, victim: Policy) -> RunConfig:
    """``config`` with its victim named so that it can be found again from anywhere, and its hash."""
    info = victim.info
    return config.model_copy(update={"victim": info.name, "victim_sha256": info.sha256})
