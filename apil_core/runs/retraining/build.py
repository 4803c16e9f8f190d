"""Build a retraining's game, trainable victim, opponents and trainer from its settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import nn

from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.common.errors import ConfigError, VictimError
from apil_core.common.seeds import stream_seed
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.default_victim import default_baseline
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.policies.frozen_policy import FrozenPolicy, StoredCritic
from apil_core.policies.loading import LoadOptions, load_victim
from apil_core.policies.network import NetworkShape, PolicyNetwork, Standardizer, Weights
from apil_core.runs.retraining.config import MIXED, RetrainConfig
from apil_core.runs.retraining.environment import FixedObservations, OpponentStats
from apil_core.runs.retraining.mixture import MixturePolicy
from apil_core.runs.retraining.settings import BASELINE
from apil_core.runs.retraining.trainable import LINEAR, trainable
from apil_core.runs.retraining.trainer import RetrainTrainer
from apil_core.runs.runner import check_recorders
from apil_core.training.attack_env import AttackEnv
from apil_core.training.build import RunParts, check_device, generators, seeded_games
from apil_core.training.distributed.world import ALONE
from apil_core.training.networks import mlp
from apil_core.training.recurrent_ppo import NetworkLearner, NetworkModel
from apil_core.training.rewards import resolve_weights


@one_torch_thread()
def prepare(config: RetrainConfig, plugins: PluginRegistry) -> RetrainTrainer:
    """Build everything; seeds torch's global generator.

    Raises:
        ApilError: anything wrong with names, weights, sizes or shares, before anything is played.
    """
    device = check_device(config.device)
    _check_numbers(config)
    check_recorders(config, plugins)
    config = _with_baseline(config, plugins)
    game = seeded_games(config, plugins, ALONE, "training games")
    try:
        torch.manual_seed(config.seed)
        victim = load_victim(
            config.victim, game, config.victim_side, config.device, plugins, LoadOptions(config.trust)
        )
        parts = trainable(victim)
        opponents = _opponents(config, game, plugins)
        config = _pinned(config, victim, opponents)
        attack, stored = _attack(config, game, parts, opponents, plugins, device)
        infos = {label: policy.info for label, policy in opponents.items()}
        trainer = RetrainTrainer(config, attack, plugins, victim.info, infos, stored)
        _check_budget(config, trainer.warmup)
    except BaseException:
        game.close()
        raise
    return trainer


def _check_numbers(config: RetrainConfig) -> None:
    parts = config.ppo.minibatches
    if config.num_envs < parts:
        raise ConfigError(
            f"num_envs ({config.num_envs}) must be at least ppo.minibatches ({parts}): "
            "a minibatch is some of the games"
        )


def _check_budget(config: RetrainConfig, warmup: int) -> None:
    if config.steps <= warmup * config.rollout_steps:
        raise ConfigError(
            f"{config.steps:,} steps leave {config.victim} as it is: the first {warmup} iterations "
            f"of {config.rollout_steps:,} steps train the critic alone (critic_warmup)"
        )


def _with_baseline(config: RetrainConfig, plugins: PluginRegistry) -> RetrainConfig:
    """Return ``config`` with the baseline's full name, or without one where the game has none."""
    if config.baseline != "auto":
        return config
    spec = plugins.game(config.env)
    found = default_baseline(spec, plugins) if config.victim_side == spec.victim_side else ""
    if not found and config.adversary_share < 1:
        raise ConfigError(
            f"{config.env} has no baseline adversary for the {spec.sides[1 - config.victim_side]}: name one "
            "with --baseline, or retrain against the adversaries alone with --adversary-share 1"
        )
    labels = config.labels if found else tuple(label for label in config.labels if label != BASELINE)
    return config.model_copy(update={"baseline": found, "labels": labels})


def _opponents(config: RetrainConfig, game: Game, plugins: PluginRegistry) -> dict[str, Policy]:
    found = {}
    for number, (label, name) in enumerate(config.opponents.items()):
        load_options = LoadOptions(
            config.trust, stream_seed(config.seed, f"opponent {number}'s hooks"), second=True
        )
        found[label] = load_victim(name, game, 1 - config.victim_side, config.device, plugins, load_options)
    return found


def _pinned(config: RetrainConfig, victim: Policy, opponents: dict[str, Policy]) -> RetrainConfig:
    """Return ``config`` with every policy's full name and hash; on a resume these must equal the stored ones.

    Raises:
        VictimError: a policy's weights have changed.
    """
    infos = [victim.info, *(policy.info for policy in opponents.values())]
    many = 1 + len(config.adversaries)
    before = (config.victim_sha256, *(config.adversary_sha256 or [""] * (many - 1)), config.baseline_sha256)
    for info, expected in zip(infos, before, strict=False):
        if expected not in ("", info.sha256):
            raise VictimError(
                f"{info.name} has changed since the retraining began: SHA-256 {info.sha256}, "
                f"expected {expected}"
            )
    names, digests = ([*(getattr(info, key) for info in infos), ""] for key in ("name", "sha256"))
    return config.model_copy(
        update={
            "victim": names[0],
            "victim_sha256": digests[0],
            "adversaries": tuple(names[1:many]),
            "adversary_sha256": tuple(digests[1:many]),
            "baseline": names[many],  # the last, or none
            "baseline_sha256": digests[many],
        }
    )


def _attack(
    config: RetrainConfig,
    game: Game,
    parts: FrozenPolicy,
    opponents: dict[str, Policy],
    plugins: PluginRegistry,
    device: torch.device,
) -> tuple[RunParts, StoredCritic | None]:
    """Build the parts of a run with the seats swapped: the victim learns, the opponents are frozen."""
    frozen, seed = [opponents[name] for name in config.shares], stream_seed(config.seed, "retraining turns")
    mixture = MixturePolicy(frozen, list(config.shares.values()), config.mix, seed).to(device)
    hooks = RunHookManager((), {})
    hooks.device = device
    streams = generators(config.seed, device)
    mean, std = (parts.weights[f"observation.{name}"] for name in ("mean", "std"))
    builder = FixedObservations(hooks, Standardizer(mean, std, parts.shape.clip).to(device))
    weights = resolve_weights(config.reward, plugins.game(config.env).rewards)
    env = AttackEnv(
        game,
        mixture,
        builder,
        hooks,
        config.model_copy(update={"victim_actions": config.adversary_actions}),
        weights=replace(weights, anneal_fraction=0.0),
        adversary_side=config.victim_side,
        generators=streams,
        victim_answers=True,
    )
    per_step = config.mix == "per_step" and len(opponents) > 1
    labels, layout = (MIXED,) if per_step else config.labels, game.layout
    env.stats = OpponentStats(mixture, labels, game.num_envs, layout.causes, device)
    actor = NetworkModel(_copy(parts.shape, parts.weights), parts.weights["log_std"])
    critic, stored = _critic(config, parts)
    example = env.get_observations()
    learner = NetworkLearner(actor, critic, example, env.buffer, config.ppo, device, layout.max_steps)
    return RunParts(
        config, game, mixture, config.victim_side, {}, hooks, builder, streams, env, learner, ALONE
    ), stored


def _critic(config: RetrainConfig, parts: FrozenPolicy) -> tuple[NetworkModel, StoredCritic | None]:
    stored = parts.critic if config.critic != "new" else None
    if stored is not None:
        critic = NetworkModel(_copy(stored.shape, stored.weights))
        return critic.requires_grad_(config.freeze != "value"), stored
    if config.critic == "stored":
        raise ConfigError(f"--critic stored: {config.victim} brings no value network; zoo agents do")
    if config.freeze == "value":
        raise ConfigError("--freeze value needs the victim's own value network: a new one knows nothing yet")
    return NetworkModel(_new_critic(parts.shape, config.ppo.hidden)), None


def _copy(shape: NetworkShape, weights: Weights) -> PolicyNetwork:
    return PolicyNetwork.of(shape, {name: tensor.detach().clone() for name, tensor in weights.items()})


def _new_critic(shape: NetworkShape, hidden: Sequence[int]) -> PolicyNetwork:
    """Make a feed-forward critic of the victim's observation; torch's global generator draws its weights.

    It is not recurrent: the observation contains the opponent's state, and without a second pass through time
    an update takes a third less.
    """
    layers = [layer for layer in mlp((shape.observation_size, *hidden, 1)) if isinstance(layer, nn.Linear)]
    weights = {f"mlp.{i}.{name}": getattr(layer, name) for i, layer in enumerate(layers) for name in LINEAR}
    return _copy(NetworkShape("mlp", shape.observation_size, 1, 0, tuple(hidden), shape.clip), weights)
