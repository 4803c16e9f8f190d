"""Scoring an adversary: win, tie and loss rates with intervals, and how the games ended."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import torch
from pydantic import BaseModel

from apil_core import checkpoint
from apil_core.build import adversary_policy, check_device, load_victim, victim_name, victim_side
from apil_core.config import ActionMode, RunConfig
from apil_core.errors import ConfigError, RunDirError
from apil_core.files import sha256
from apil_core.game import Game
from apil_core.play import Filter, Seat, Tally, play
from apil_core.plugins import PluginRegistry, discover
from apil_core.policy import Policy, PolicyInfo
from apil_core.progress import Progress
from apil_core.registry import default_plugins, make_game
from apil_core.run_hooks import RunHookManager
from apil_core.rundir import RunDir
from apil_core.types import Context

MAX_PARALLEL_GAMES = 128
"""Slots of an evaluation unless asked otherwise. Fixed, so that a seed gives the same games anywhere."""


class Rate(BaseModel):
    """A share of games with its Wilson 95 % interval, as fractions."""

    value: float
    low: float
    high: float


class PolicyId(BaseModel):
    """Who played."""

    name: str
    sha256: str


class EvaluationResult(BaseModel):
    """A score and all it depends on. ``wins`` and the like are the adversary's."""

    env: str
    episodes: int
    wins: int
    ties: int
    losses: int
    win_rate: Rate
    tie_rate: Rate
    loss_rate: Rate
    win_or_tie_rate: Rate
    causes: dict[str, int]
    mean_length: float
    adversary: PolicyId
    victim: PolicyId
    adversary_side: str
    victim_side: str
    adversary_actions: ActionMode
    victim_actions: ActionMode
    seed: int
    num_envs: int
    trained_steps: int | None = None
    game_options: dict[str, Any]
    versions: dict[str, str]
    wall_seconds: float


def wilson(count: int, total: int) -> Rate:
    """Share ``count / total`` with the Wilson score interval at 95 %."""
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(count, total, alpha=0.05, method="wilson")
    # rounding leaves 4e-18 where the interval starts at nought
    return Rate(value=count / total, low=max(float(low), 0.0) if count else 0.0, high=min(float(high), 1.0))


def score(
    game: Game,
    adversary: Policy,
    victim: Policy,
    *,
    config: RunConfig,
    adversary_side: int,
    episodes: int,
    seed: int,
    hooks: RunHookManager | None = None,
    trained_steps: int | None = None,
    progress: Progress | None = None,
) -> EvaluationResult:
    """Play ``episodes`` games and summarise them.

    Uses no global randomness: a seed gives the same games at any number of threads.

    Args:
        game: its generator is reseeded.
        config: gives the action modes (``config.evaluation``), the game's name and options.
        hooks: of the adversary's run; its ``filter_observation`` hooks apply here too.
    """
    begin = time.perf_counter()
    progress = progress or Progress()
    game.seed(seed)
    device = torch.device(config.device)
    modes = config.evaluation
    seats: dict[int, Seat] = {}
    contexts: dict[int, Context] = {}
    for side, policy, mode in (
        (adversary_side, adversary, modes.adversary_actions),
        (1 - adversary_side, victim, modes.victim_actions),
    ):
        generator = torch.Generator(device=device).manual_seed(2 * seed + side)
        seats[side] = Seat(policy, mode == "sample", generator)
        role = "adversary" if side == adversary_side else "victim"
        contexts[side] = Context(side, role, "eval", device, generator)  # type: ignore[arg-type]
    tally = play(
        game,
        (seats[0], seats[1]),
        episodes,
        adversary_side=adversary_side,
        device=device,
        observation_filter=Filter(hooks, adversary_side, contexts),
        on_progress=lambda ended: progress.evaluation_progress(ended, episodes),
    )
    counts = _counts(tally, game, adversary_side)
    return EvaluationResult(
        **counts,
        env=config.env,
        adversary=PolicyId(name=adversary.info.name, sha256=adversary.info.sha256),
        victim=PolicyId(name=victim.info.name, sha256=victim.info.sha256),
        adversary_side=game.layout.sides[adversary_side].name,
        victim_side=game.layout.sides[1 - adversary_side].name,
        adversary_actions=modes.adversary_actions,
        victim_actions=modes.victim_actions,
        seed=seed,
        num_envs=game.num_envs,
        trained_steps=trained_steps,
        game_options=config.game,
        versions={name: metadata.version(name) for name in ("apil", "mujoco", "torch", "numpy")},
        wall_seconds=time.perf_counter() - begin,
    )


def _counts(tally: Tally, game: Game, adversary_side: int) -> dict[str, Any]:
    winners = Counter(tally.winners)
    wins, losses = winners[adversary_side], winners[1 - adversary_side]
    total = len(tally.winners)
    causes = Counter(tally.causes)
    return {
        "episodes": total,
        "wins": wins,
        "ties": total - wins - losses,
        "losses": losses,
        "win_rate": wilson(wins, total),
        "tie_rate": wilson(total - wins - losses, total),
        "loss_rate": wilson(losses, total),
        "win_or_tie_rate": wilson(total - losses, total),
        "causes": {name: causes[i] for i, name in enumerate(game.layout.causes) if causes[i]},
        "mean_length": sum(tally.lengths) / total,
    }


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
        game_options: override the run's game options.
        checkpoint_path: score this checkpoint of the run rather than its newest.

    Raises:
        ApilError: anything wrong with the names, files or sizes given.
    """
    if episodes < 1:
        raise ConfigError(f"episodes must be at least 1, got {episodes}")
    check_device(device)
    is_run = Path(adversary).is_dir()
    if not is_run and ":" not in str(adversary):
        raise RunDirError(f"{adversary} is neither a run directory nor a policy name like zoo:GAME/ROLE/v1")
    config = RunDir(adversary).config() if is_run else RunConfig(env=env or "", method="adrl")
    if not is_run and env is None:
        raise ConfigError(f"say which game {adversary} plays: --env GAME")
    if is_run and env not in (None, config.env):
        raise ConfigError(f"{adversary} was trained on {config.env}; it cannot play {env}")
    plugins = plugins or (
        discover([*config.plugins, *plugin_files]) if config.plugins or plugin_files else default_plugins()
    )
    config = _adjust(config, victim, device, adversary_actions, victim_actions, game_options)
    game = make_game(
        config.env,
        num_envs=num_envs or min(episodes, MAX_PARALLEL_GAMES),
        threads=threads,
        options=config.game,
        plugins=plugins,
    )
    torch.set_num_threads(1)  # one thread: the same bits whatever the machine
    attacked = victim_side(config, plugins)
    opponent = load_victim(victim_name(config, plugins), game, attacked, device, plugins)
    if is_run:
        policy, hooks, steps = load_adversary(
            RunDir(adversary), config, game, plugins, seed=seed, path=checkpoint_path
        )
    else:
        policy, hooks, steps = load_victim(str(adversary), game, 1 - attacked, device, plugins), None, None
    try:
        return score(
            game,
            policy,
            opponent,
            config=config,
            adversary_side=1 - attacked,
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
) -> tuple[Policy, RunHookManager, int]:
    """The adversary of a run's newest (or given) checkpoint, its hooks, and its training steps."""
    path = path or run_dir.newest_checkpoint()
    state = checkpoint.read(path, config.device)
    info = PolicyInfo(
        name=f"run:{run_dir.path}",
        sha256=sha256(path),
        observation_size=game.layout.sides[1 - victim_side(config, plugins)].observation_size,
        action_size=game.layout.sides[1 - victim_side(config, plugins)].action_size,
    )
    side = 1 - victim_side(config, plugins)
    policy, hooks = adversary_policy(state, info, config, game, side, plugins, seed)
    return policy, hooks, int(state["steps"])


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
    if game_options is not None:
        config.game = game_options
    return config
