"""An adversary and a victim, loaded by name and ready to play: what scoring and watching start from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, TypedDict

import torch

from apil_core.api.config import ActionMode, RunConfig
from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.profiles import Profile
from apil_core.api.types import Context
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.config.absent import completed
from apil_core.config.game import with_game_options
from apil_core.config.observers import Observers, about, with_observers
from apil_core.evaluation.play import Players, Seat
from apil_core.evaluation.results import PolicyId, observers_played
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import make_game, plugins_with
from apil_core.policies.seats import BASELINES, Taking, load_victim, run_victim, victim_side
from apil_core.training.build import check_device, observing_alone
from apil_core.training.export.run_policy import SCHEME, Source, run_path
from apil_core.training.observation_filter import ObservationFilter

_PACKAGES = ("apil", "mujoco", "torch", "numpy")


@dataclass
class Pairing:
    """Who plays what against whom. Use it in ``with``, or call :meth:`close`.

    Attributes:
        config: the adversary's run's (a named policy: the defaults), adjusted to what was asked for.
        game: not yet seeded.
        adversary, victim: the players.
        side: index of the adversary's seat.
        hooks: of the adversary's run; for a named policy of observers alone, or ``None``.
        steps: the adversary was trained for, or ``None`` for a named policy.
    """

    config: RunConfig
    game: Game
    adversary: Policy
    victim: Policy
    side: int
    hooks: RunHookManager | None = None
    steps: int | None = None

    @property
    def device(self) -> torch.device:
        """Where the networks live."""
        return torch.device(self.config.device)

    def players(self, seed: int) -> Players:
        """Both in their seats, each with its action mode and a generator of its own."""
        modes = self.config.evaluation
        generators = self.generators(seed, "evaluation seat")
        who = {
            self.side: (self.adversary, modes.adversary_actions),
            1 - self.side: (self.victim, modes.victim_actions),
        }
        first, second = (Seat(who[i][0], who[i][1] == "sample", generators[i]) for i in (0, 1))
        return Players((first, second), self.side, self.device, self.observation_filter(generators))

    def generators(self, seed: int, stream: str) -> tuple[torch.Generator, torch.Generator]:
        """One for each side."""
        first, second = (stream_generator(seed, f"{stream} {side}", self.device) for side in (0, 1))
        return first, second

    def observation_filter(self, generators: Sequence[torch.Generator]) -> ObservationFilter:
        """The run's ``filter_observation`` hooks; side i's draw from ``generators[i]``."""
        contexts = {
            side: Context(
                side=side,
                role="adversary" if side == self.side else "victim",
                seat=self.game.layout.sides[side],
                mode="eval",
                device=self.device,
                generator=generator,
            )
            for side, generator in enumerate(generators)
        }
        return ObservationFilter(self.hooks, contexts)

    @contextmanager
    def attribution(self) -> Iterator[None]:
        """Put a plugin's name on what its hooks raise."""
        with nullcontext() if self.hooks is None else self.hooks.attribution():
            yield

    def close(self) -> None:
        """Release the game."""
        self.game.close()

    def __enter__(self) -> Pairing:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class PairingOptions(TypedDict, total=False):
    """Keywords of :func:`load_pairing` for functions that pass them on, ``seed`` and ``num_envs`` aside."""

    env: str | None
    victim: str | None
    adversary_actions: ActionMode | None
    victim_actions: ActionMode | None
    game_options: Mapping[str, Any] | None
    observers: Observers | None
    sets: Sequence[str]
    physics: Profile | None
    threads: int
    device: str
    plugins: PluginRegistry | None
    plugin_files: Sequence[str]
    checkpoint_path: Path | None
    trust: bool
    victim_seat: Literal[0, 1] | None


def as_in_run(config: RunConfig, plugins: PluginRegistry) -> PairingOptions:
    """How a named policy plays in place of a run's adversary: its game, victim and ways to act."""
    modes = config.evaluation
    return {
        "env": config.env,
        "victim": config.victim,
        "game_options": config.game,
        "plugins": plugins,
        "trust": config.trust,
        "adversary_actions": modes.adversary_actions,
        "victim_actions": modes.victim_actions,
    }


def load_pairing(
    adversary: Path | str,
    *,
    num_envs: int,
    env: str | None = None,
    victim: str | None = None,
    adversary_actions: ActionMode | None = None,
    victim_actions: ActionMode | None = None,
    game_options: Mapping[str, Any] | None = None,
    observers: Observers | None = None,
    sets: Sequence[str] = (),
    physics: Profile | None = None,
    seed: int = 0,
    threads: int = 0,
    device: str = "cpu",
    plugins: PluginRegistry | None = None,
    plugin_files: Sequence[str] = (),
    checkpoint_path: Path | None = None,
    trust: bool = False,
    victim_seat: Literal[0, 1] | None = None,
) -> Pairing:
    """Load an adversary, its victim and their game.

    Args:
        adversary: a run (``DIR`` or ``run:DIR``), or a policy name such as
            ``"zoo:kick-and-defend/defender/v1"``; ``"random"`` and ``"zero"`` do for either player.
        num_envs: games in parallel.
        env: the game; needed for a policy name, and only allowed to repeat a run's own.
        victim: policy name, or a run that trained this seat; default: the run's victim, or the game's.
        adversary_actions, victim_actions: ``"sample"`` or ``"mode"``; default: the run's setting.
        game_options: single options of the game to change.
        observers: to switch on besides the run's, with their options: defences, say.
        sets: both as texts, ``game.KEY=VALUE`` and ``options.OBSERVER.KEY=VALUE``; they have the last word.
        physics: profile to play in; single values of the run's physics (``solver``, …) do not count then.
        seed: of what stochastic hooks of the adversary draw from.
        threads: physics threads (0: all CPUs); never changes the result.
        device: of the networks.
        plugins: registry to use; default: installed plugins plus the run's one-file plugins.
        plugin_files: further one-file plugins.
        checkpoint_path: take this checkpoint of the run rather than its newest.
        trust: allow ``adversary`` and ``victim`` to be names whose loading runs code of the user's.
        victim_seat: the victim's side, for a policy name; default: the game's.

    Raises:
        ApilError: anything wrong with the names, files, options or sizes given.
    """
    check_device(device)
    _check_numbers(seed=(seed, 0), num_envs=(num_envs, 1), threads=(threads, 0))
    source, stored = _stored(adversary, env, checkpoint_path)
    plugins = plugins or _plugins([stored, *_victims_config(victim)], plugin_files)
    about_observers, others = about(observers or {}, sets)
    stored = stored if source is None else completed(stored, plugins)
    config = with_game_options(stored, plugins, game_options, others, physics)
    config = with_observers(config, plugins, observers or {}, about_observers)
    _adjust(config, victim, trust, device, adversary_actions, victim_actions)
    if source is None and victim_seat is not None:
        config.victim_side = victim_seat
    game = make_game(config.env, num_envs=num_envs, threads=threads, options=config.game, plugins=plugins)
    try:
        return _seated(source or str(adversary), config, game, plugins, seed, trust)
    except BaseException:
        game.close()
        raise


def _seated(
    adversary: Source | str, config: RunConfig, game: Game, plugins: PluginRegistry, seed: int, trust: bool
) -> Pairing:
    """Both players in their seats: what a run trained, or the policy of that name, and the victim."""
    side = 1 - victim_side(config, plugins)
    opponent = run_victim(config, game, plugins, seed)
    if isinstance(adversary, str):
        taking = Taking(trust, stream_seed(seed, "adversary's hooks"), second=True)
        named = load_victim(adversary, game, side, config.device, plugins, taking)
        hooks = observing_alone(config, game.layout, side, plugins)
        return Pairing(config, game, named, opponent, side, hooks)
    name = f"{SCHEME}{adversary.run_dir.path}"
    trained, steps = adversary.policy(config, game.layout, plugins, seed, name)
    return Pairing(config, game, trained, opponent, side, trained.hooks, steps)


def _victims_config(victim: str | None) -> list[RunConfig]:
    path = None if victim is None else run_path(victim)
    return [] if path is None else [Source.find(path).run_dir.config()]


def _stored(
    adversary: Path | str, env: str | None, checkpoint_path: Path | None
) -> tuple[Source | None, RunConfig]:
    """The run behind ``adversary`` and its settings, or none and the defaults for a policy name."""
    path = run_path(adversary)
    if path is not None:
        source = Source.find(path, checkpoint_path)
        config = source.run_dir.config()
        if env not in (None, config.env):
            raise ConfigError(f"{adversary} was trained on {config.env}; it cannot play {env}")
        return source, config
    if checkpoint_path is not None:
        raise ConfigError(f"{adversary} is no run: there is no checkpoint to choose")
    if ":" not in str(adversary) and str(adversary) not in BASELINES:
        raise RunDirError(f"{adversary} is neither a run directory nor a policy name like zoo:GAME/ROLE/v1")
    if env is None:
        raise ConfigError(f"say which game {adversary} plays: --env GAME")
    return None, RunConfig(env=env)


def _plugins(configs: Sequence[RunConfig], plugin_files: Sequence[str]) -> PluginRegistry:
    files = [*(file for config in configs for file in config.plugins), *plugin_files]
    return plugins_with(files)


def _check_numbers(**numbers: tuple[int, int]) -> None:
    for name, (value, least) in numbers.items():
        if value < least:
            raise ConfigError(f"{name} must be at least {least}, got {value}")


def _adjust(
    config: RunConfig,
    victim: str | None,
    trust: bool,
    device: str,
    adversary_actions: ActionMode | None,
    victim_actions: ActionMode | None,
) -> None:
    config.device = device
    if victim is not None:
        config.victim, config.victim_sha256, config.trust = victim, "", trust
    if adversary_actions is not None:
        config.evaluation.adversary_actions = adversary_actions
    if victim_actions is not None:
        config.evaluation.victim_actions = victim_actions


def circumstances(pairing: Pairing, seed: int) -> dict[str, Any]:
    """The fields of :class:`Circumstances` for games of that pairing."""
    config, sides = pairing.config, pairing.game.layout.sides
    return {
        "env": config.env,
        "adversary": PolicyId.of(pairing.adversary.info),
        "victim": PolicyId.of(pairing.victim.info),
        "adversary_side": sides[pairing.side].name,
        "victim_side": sides[1 - pairing.side].name,
        "adversary_actions": config.evaluation.adversary_actions,
        "victim_actions": config.evaluation.victim_actions,
        "seed": seed,
        "num_envs": pairing.game.num_envs,
        "trained_steps": pairing.steps,
        "game_options": config.game,
        "game_settings": pairing.game.settings,
        "observers": observers_played(config),
        "versions": {name: metadata.version(name) for name in (*_PACKAGES, *pairing.game.packages)},
    }
