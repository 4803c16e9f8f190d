"""Scoring by name: from a run directory or a policy name to an :class:`EvaluationResult`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from apil_core import checkpoint
from apil_core.build import adversary_policy, check_device, load_victim, victim_name, victim_side
from apil_core.checkpoint_fit import POLICY_KEYS, check_same_run, fitting
from apil_core.config import ActionMode, RunConfig
from apil_core.config_io import complete
from apil_core.errors import ConfigError, RunDirError
from apil_core.evaluation import MAX_PARALLEL_GAMES, EvaluationResult, score
from apil_core.files import sha256
from apil_core.game import Game
from apil_core.plugins import PluginRegistry, discover
from apil_core.policy import Policy, PolicyInfo
from apil_core.progress import Progress
from apil_core.registry import default_plugins, make_game
from apil_core.run_hooks import RunHookManager
from apil_core.rundir import RunDir
from apil_core.torch_threads import one_torch_thread


def evaluate(
    adversary: Path | str,
    *,
    env: str | None = None,
    victim: str | None = None,
    episodes: int = 1000,
    adversary_actions: ActionMode | None = None,
    victim_actions: ActionMode | None = None,
    seed: int = 0,
    num_envs: int | None = None,
    threads: int = 0,
    device: str = "cpu",
    progress: Progress | None = None,
    plugins: PluginRegistry | None = None,
    plugin_files: Sequence[str] = (),
    game_options: dict[str, Any] | None = None,
    checkpoint_path: Path | None = None,
) -> EvaluationResult:
    """Score an adversary against a victim.

    Args:
        adversary: a run directory, or a policy name such as ``"zoo:kick-and-defend/defender/v1"``.
        env: the game; needed for a policy name, and only allowed to repeat a run's own.
        victim: policy name; default: the run's victim, or the game's default.
        episodes: number of games.
        adversary_actions, victim_actions: ``"sample"`` or ``"mode"``; default: the run's setting.
        seed: of the games and all draws.
        num_envs: games in parallel (part of what a seed means); default 128 or ``episodes``.
        threads: physics threads (0: all CPUs); never changes the result.
        device: of the networks.
        progress: told of the games played.
        plugins: registry to use; default: installed plugins plus the run's one-file plugins.
        plugin_files: further one-file plugins.
        game_options: override single options of the run's game.
        checkpoint_path: score this checkpoint of the run rather than its newest.

    Raises:
        ApilError: anything wrong with the names, files or sizes given.
    """
    if episodes < 1:
        raise ConfigError(f"episodes must be at least 1, got {episodes}")
    check_device(device)
    run_dir, config = _config(adversary, env)
    plugins = plugins or _plugins(config, plugin_files)
    if run_dir is None:
        config = complete(config, plugins)  # so that the score names every option of the game
    config = _adjust(config, victim, device, adversary_actions, victim_actions, game_options)
    side = 1 - victim_side(config, plugins)
    game = make_game(
        config.env,
        num_envs=num_envs or min(episodes, MAX_PARALLEL_GAMES),
        threads=threads,
        options=config.game,
        plugins=plugins,
    )
    try:
        opponent = load_victim(victim_name(config, plugins), game, 1 - side, device, plugins)
        policy, hooks, steps = (
            (load_victim(str(adversary), game, side, device, plugins), None, None)
            if run_dir is None
            else load_adversary(run_dir, config, game, plugins, seed=seed, path=checkpoint_path)
        )
        with one_torch_thread(), hooks.attribution() if hooks else nullcontext():
            return score(
                game,
                policy,
                opponent,
                config=config,
                adversary_side=side,
                episodes=episodes,
                seed=seed,
                hooks=hooks,
                trained_steps=steps,
                progress=progress,
            )
    finally:
        game.close()


def load_adversary(
    run_dir: RunDir,
    config: RunConfig,
    game: Game,
    plugins: PluginRegistry,
    *,
    seed: int,
    path: Path | None = None,
) -> tuple[Policy, RunHookManager | None, int | None]:
    """The adversary of a run's newest (or given) checkpoint, its hooks, and its training steps."""
    path = path or run_dir.newest_checkpoint()
    state = checkpoint.read(path)
    check_same_run(state, config, path, POLICY_KEYS)
    side = 1 - victim_side(config, plugins)
    seat = game.layout.sides[side]
    info = PolicyInfo(f"run:{run_dir.path}", sha256(path), seat.observation_size, seat.action_size)
    with fitting(path):
        policy, hooks = adversary_policy(state, info, config, game, side, plugins, seed)
    return policy, hooks, int(state["steps"])


def _config(adversary: Path | str, env: str | None) -> tuple[RunDir | None, RunConfig]:
    """The run behind ``adversary`` and its settings, or none and the defaults for a policy name."""
    if Path(adversary).is_dir():
        run_dir = RunDir(adversary)
        config = run_dir.config()
        if env not in (None, config.env):
            raise ConfigError(f"{adversary} was trained on {config.env}; it cannot play {env}")
        return run_dir, config
    if ":" not in str(adversary):
        raise RunDirError(f"{adversary} is neither a run directory nor a policy name like zoo:GAME/ROLE/v1")
    if env is None:
        raise ConfigError(f"say which game {adversary} plays: --env GAME")
    return None, RunConfig(env=env)


def _plugins(config: RunConfig, plugin_files: Sequence[str]) -> PluginRegistry:
    files = [*config.plugins, *plugin_files]
    return discover(files) if files else default_plugins()


def _adjust(
    config: RunConfig,
    victim: str | None,
    device: str,
    adversary_actions: ActionMode | None,
    victim_actions: ActionMode | None,
    game_options: dict[str, Any] | None,
) -> RunConfig:
    config = config.model_copy(deep=True)
    config.device = device
    if victim is not None:
        config.victim = victim
    if adversary_actions is not None:
        config.evaluation.adversary_actions = adversary_actions
    if victim_actions is not None:
        config.evaluation.victim_actions = victim_actions
    config.game = {**config.game, **(game_options or {})}
    return config
