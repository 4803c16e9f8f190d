"""An adversary and a victim, loaded by name and ready to play, for scoring and videos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import torch

from apil_core.api.config import RunConfig
from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.types import Context
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.config.absent import completed
from apil_core.config.game import with_game_options
from apil_core.config.observers import about, with_observers
from apil_core.evaluation.options import PairingOptions
from apil_core.evaluation.play import Players, Seat
from apil_core.evaluation.results import PolicyId, observers_played
from apil_core.plugins.defined import PolicyLike, policy_name
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import make_game, plugins_with
from apil_core.policies.loading import BASELINES, LoadOptions, load_victim, run_victim, victim_side
from apil_core.training.build import check_device, observing_alone
from apil_core.training.export.run_policy import SCHEME, RunCheckpoint, run_path
from apil_core.training.observation_filter import ObservationFilter

_PACKAGES = ("apil", "mujoco", "torch", "numpy")


@dataclass
class Pairing:
    """An adversary, a victim and their game. Use it in ``with``, or call :meth:`close`.

    Attributes:
        config: the adversary's run's (a named policy: the defaults), with the given options applied.
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
        """Device of the networks."""
        return torch.device(self.config.device)

    def players(self, seed: int) -> Players:
        """Both players by seat, each with its action mode and its own generator."""
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
        """Add a plugin's name to exceptions of its hooks."""
        with nullcontext() if self.hooks is None else self.hooks.attribution():
            yield

    def setup(self, seed: int) -> dict[str, Any]:
        """The fields of :class:`MatchSetup` for games of that seed."""
        config, sides = self.config, self.game.layout.sides
        return {
            "env": config.env,
            "adversary": PolicyId.of(self.adversary.info),
            "victim": PolicyId.of(self.victim.info),
            "adversary_side": sides[self.side].name,
            "victim_side": sides[1 - self.side].name,
            "adversary_actions": config.evaluation.adversary_actions,
            "victim_actions": config.evaluation.victim_actions,
            "seed": seed,
            "num_envs": self.game.num_envs,
            "trained_steps": self.steps,
            "game_options": config.game,
            "game_settings": self.game.settings,
            "observers": observers_played(config),
            "white_box": self.hooks is not None and self.hooks.white_box,
            "versions": {name: metadata.version(name) for name in (*_PACKAGES, *self.game.packages)},
        }

    def close(self) -> None:
        """Release the game."""
        self.game.close()

    def __enter__(self) -> Pairing:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def load_pairing(adversary: PolicyLike, options: PairingOptions | None = None, **changes: Any) -> Pairing:
    """Load an adversary, its victim and their game.

    Args:
        adversary: a run (``DIR`` or ``run:DIR``), a policy, or its name such as
            ``"zoo:kick-and-defend/defender/v1"``; ``"random"`` and ``"zero"`` do for either player.
        options: default: none. ``sets`` take precedence for the game; ``physics`` hides single values of a
            run's physics (``solver``, …); ``num_envs`` is 1 by default.
        changes: single options, over ``options``.

    Raises:
        ApilError: names, files, options or sizes are wrong.
    """
    options = PairingOptions.of(options, **changes) if changes or options is None else options
    check_device(options.device)
    adversary = policy_name(adversary)
    source, stored = _stored(adversary, options)
    plugins = options.plugins or _plugins([stored, *_victims_config(options.victim)], options.plugin_files)
    about_observers, others = about(options.observers, options.sets)
    if source is not None or options.like is not None:
        stored = completed(stored, plugins)
    config = with_game_options(stored, plugins, options.game_options, others, options.physics)
    config = with_observers(config, plugins, options.observers, about_observers)
    _adjust(config, options)
    if source is None and options.victim_seat is not None:
        config.victim_side = options.victim_seat
    envs, threads = options.num_envs or 1, options.threads
    game = make_game(config.env, num_envs=envs, threads=threads, options=config.game, plugins=plugins)
    try:
        return _seated(source or adversary, config, game, plugins, options)
    except BaseException:
        game.close()
        raise


def _seated(
    adversary: RunCheckpoint | str,
    config: RunConfig,
    game: Game,
    plugins: PluginRegistry,
    options: PairingOptions,
) -> Pairing:
    """Load both players in their seats: a run's adversary or a named policy, and the victim."""
    side, seed = 1 - victim_side(config, plugins), options.seed
    opponent = run_victim(config, game, plugins, seed)
    if isinstance(adversary, str):
        load_options = LoadOptions(options.trust, stream_seed(seed, "adversary's hooks"), second=True)
        named = load_victim(adversary, game, side, config.device, plugins, load_options)
        hooks = observing_alone(config, game.layout, side, plugins)
        return Pairing(config, game, named, opponent, side, hooks)
    name = f"{SCHEME}{adversary.run_dir.path}"
    trained, steps = adversary.policy(config, game.layout, plugins, seed, name)
    return Pairing(config, game, trained, opponent, side, trained.hooks, steps)


def _victims_config(victim: str | None) -> list[RunConfig]:
    path = None if victim is None else run_path(victim)
    return [] if path is None else [RunCheckpoint.find(path).run_dir.config()]


def _stored(adversary: str, options: PairingOptions) -> tuple[RunCheckpoint | None, RunConfig]:
    """The run behind ``adversary`` and its settings; for a policy name none, and those it plays with."""
    path, env, like = run_path(adversary), options.env, options.like
    if path is not None:
        source = RunCheckpoint.find(path, options.checkpoint_path)
        config = source.run_dir.config()
        if env not in (None, config.env):
            raise ConfigError(f"{adversary} was trained on {config.env}; it cannot play {env}")
        return source, config
    if options.checkpoint_path is not None:
        raise ConfigError(f"{adversary} is no run: there is no checkpoint to choose")
    if ":" not in adversary and adversary not in BASELINES:
        raise RunDirError(f"{adversary} is neither a run directory nor a policy name like zoo:GAME/ROLE/v1")
    if like is not None and env in (None, like.env):
        return None, like
    if env is None:
        raise ConfigError(f"say which game {adversary} plays: --env GAME")
    return None, RunConfig(env=env)


def _plugins(configs: Sequence[RunConfig], plugin_files: Sequence[str]) -> PluginRegistry:
    files = [*(file for config in configs for file in config.plugins), *plugin_files]
    return plugins_with(files)


def _adjust(config: RunConfig, options: PairingOptions) -> None:
    config.device = options.device
    if options.victim is not None:
        config.victim, config.victim_sha256, config.trust = options.victim, "", options.trust
    if options.adversary_actions is not None:
        config.evaluation.adversary_actions = options.adversary_actions
    if options.victim_actions is not None:
        config.evaluation.victim_actions = options.victim_actions
