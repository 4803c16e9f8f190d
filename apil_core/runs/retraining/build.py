"""From settings to a game, a trainable victim, its opponents and the trainer between them."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from apil_core.api.config import RewardConfig
from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.specs import load
from apil_core.common.errors import ConfigError, UnknownNameError, VictimError
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.default_victim import default_baseline
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.policies.frozen_policy import StoredCritic
from apil_core.policies.loading import LoadOptions, load_victim
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.games import RetrainingGames
from apil_core.runs.retraining.learner import VictimLearner
from apil_core.runs.retraining.mixture import MixturePolicy
from apil_core.runs.retraining.network import Critic, VictimNetwork, new_critic
from apil_core.runs.retraining.settings import BASELINE
from apil_core.runs.retraining.trainable import Trainable, trainable
from apil_core.runs.retraining.trainer import RetrainTrainer
from apil_core.training.build import check_device
from apil_core.training.rewards import resolve_weights


@dataclass
class Setting:
    """The parts of a retraining.

    Attributes:
        config: with every name and hash filled in.
        game: the victim trains in.
        victim: as it was.
        opponents: by label, the baseline last if there is one.
    """

    config: RetrainConfig
    game: Game
    victim: Policy
    opponents: dict[str, Policy]
    trainer: RetrainTrainer

    def close(self) -> None:
        """Release the game."""
        self.game.close()


@one_torch_thread()
def prepare(config: RetrainConfig, plugins: PluginRegistry) -> Setting:
    """Build everything; seeds torch's global generator.

    Raises:
        ApilError: anything wrong with names, weights, sizes or shares, before anything is played.
    """
    device = check_device(config.device)
    _check_numbers(config)
    _check_recorders(config, plugins)
    config = _with_baseline(config, plugins)
    game = make_game(
        config.env, num_envs=config.num_envs, threads=config.threads, options=config.game, plugins=plugins
    )
    try:
        game.seed(stream_seed(config.seed, "retraining games"))
        torch.manual_seed(config.seed)
        victim = load_victim(
            config.victim, game, config.victim_side, config.device, plugins, LoadOptions(config.trust)
        )
        parts = trainable(victim)
        opponents = _opponents(config, game, plugins)
        config = _pinned(config, victim, opponents)
        trainer = _trainer(config, game, parts, opponents, plugins, device)
    except BaseException:
        game.close()
        raise
    return Setting(config, game, victim, opponents, trainer)


def _check_numbers(config: RetrainConfig) -> None:
    parts = config.ppo.minibatches
    if config.num_envs < parts or config.num_envs * config.ppo.num_steps < 2 * parts:
        raise ConfigError(
            f"num_envs ({config.num_envs}) must be at least ppo.minibatches ({parts}): "
            "a minibatch is some of the games"
        )


def _check_recorders(config: RetrainConfig, plugins: PluginRegistry) -> None:
    for name in config.recorders:
        if name not in plugins.recorders:
            raise UnknownNameError("recorder", name, plugins.recorders)
        if plugins.recorders[name].check:
            load(plugins.recorders[name].check)()


def _with_baseline(config: RetrainConfig, plugins: PluginRegistry) -> RetrainConfig:
    """The baseline's name spelt out; none at all where every game is the adversaries'."""
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
    names = [*config.adversaries, *([config.baseline] if config.baseline else [])]
    found = {}
    for number, (label, name) in enumerate(zip(config.labels, names, strict=True)):
        load_options = LoadOptions(
            config.trust, stream_seed(config.seed, f"opponent {number}'s hooks"), second=True
        )
        found[label] = load_victim(name, game, 1 - config.victim_side, config.device, plugins, load_options)
    return found


def _pinned(config: RetrainConfig, victim: Policy, opponents: dict[str, Policy]) -> RetrainConfig:
    """``config`` with everybody's full name and hash; on a resume these must be the old ones.

    Raises:
        VictimError: somebody's weights have changed.
    """
    infos = [policy.info for policy in opponents.values()]
    many = len(config.adversaries)
    baseline = infos[many] if len(infos) > many else None
    digests = (victim.info.sha256, *(info.sha256 for info in infos))
    names = (victim.info.name, *(info.name for info in infos))
    before = (config.victim_sha256, *(config.adversary_sha256 or [""] * many), config.baseline_sha256)
    for name, expected, actual in zip(names, before, digests, strict=False):
        if expected not in ("", actual):
            raise VictimError(
                f"{name} has changed since the retraining began: SHA-256 {actual}, expected {expected}"
            )
    return config.model_copy(
        update={
            "victim": victim.info.name,
            "victim_sha256": victim.info.sha256,
            "adversaries": tuple(info.name for info in infos[:many]),
            "adversary_sha256": tuple(info.sha256 for info in infos[:many]),
            "baseline": baseline.name if baseline else "",
            "baseline_sha256": baseline.sha256 if baseline else "",
        }
    )


def shares(config: RetrainConfig) -> dict[str, float]:
    """Share of play of each opponent by label; the adversaries have equal parts of theirs."""
    many = len(config.adversaries)
    parts = [config.adversary_share / many] * many + [1 - config.adversary_share]
    return dict(zip(config.labels, parts, strict=False))


def _trainer(
    config: RetrainConfig,
    game: Game,
    parts: Trainable,
    opponents: dict[str, Policy],
    plugins: PluginRegistry,
    device: torch.device,
) -> RetrainTrainer:
    network = VictimNetwork(parts.shape, parts.weights).to(device)
    critic, stored = _critic(config, parts)
    streams = {
        "victim": stream_generator(config.seed, "retraining victim", device),
        "order": stream_generator(config.seed, "retraining minibatches", torch.device("cpu")),
    }
    learner = VictimLearner(
        network,
        critic.to(device),
        config.ppo,
        config.num_envs,
        freeze_critic=config.freeze == "value",
        generators=streams,
    )
    games = RetrainingGames(
        config,
        game,
        _mixture(config, opponents).to(device),
        resolve_weights(RewardConfig(sparse_weight=config.sparse_weight), plugins.game(config.env).rewards),
        stream_generator(config.seed, "retraining opponents", device),
        device,
    )
    return RetrainTrainer(config, games, learner, stored)


def _mixture(config: RetrainConfig, opponents: dict[str, Policy]) -> MixturePolicy:
    seed = stream_seed(config.seed, "retraining turns")
    parts = shares(config)
    return MixturePolicy([opponents[name] for name in parts], list(parts.values()), config.mix, seed)


def _critic(config: RetrainConfig, parts: Trainable) -> tuple[Critic, StoredCritic | None]:
    stored = parts.critic if config.critic != "new" else None
    if stored is not None:
        return Critic(stored.shape, stored.weights), stored
    if config.critic == "stored":
        raise ConfigError(f"--critic stored: {config.victim} brings no value network; zoo agents do")
    if config.freeze == "value":
        raise ConfigError("--freeze value needs the victim's own value network: a new one knows nothing yet")
    return new_critic(parts.shape, config.ppo.hidden), None
