"""Games of one checkpoint's adversary, with the next checkpoint's action distribution in every state."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from apil_core.api.policy import Policy
from apil_core.api.types import Decision, View
from apil_core.common.seeds import stream_seed
from apil_core.evaluation.pairing import Pairing, load_pairing
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import game_spec
from apil_core.training.rewards import dense_share, resolve_weights, training_reward
from apil_core.training.storage.run_dir import RunDir


@dataclass
class ComparedGames:
    """Recorded games, time first: (T, n). Entries after a game's end are not ``playing``.

    Attributes:
        steps: the adversary was trained for.
        gamma: discount.
        playing: bool.
        rewards: of the victim, in training's units; 0 after the end.
        divergence: KL of the two adversaries in the state before the step, bits.
    """

    steps: int
    gamma: float
    playing: np.ndarray
    rewards: np.ndarray
    divergence: np.ndarray

    @property
    def following(self) -> np.ndarray:
        """Discounted return from each step on, (T, n): a sample of the value of the state it leads to."""
        result = np.zeros((len(self.rewards) + 1, self.rewards.shape[1]))
        for t in range(len(self.rewards) - 1, -1, -1):
            result[t] = self.rewards[t] + self.gamma * result[t + 1]
        return result[:-1]

    @property
    def values(self) -> np.ndarray:
        """Sampled Γ of each game, (n,)."""
        values: np.ndarray = self.gamma * self.following[0]
        return values


class ComparedPolicy(Policy):
    """Acts as the first policy, and stores the KL between its distribution and the second one's."""

    def __init__(self, policy: Policy, other: Policy | None):
        self.info = policy.info
        self.policy = policy
        self.other = other
        self.divergence: np.ndarray | float = 0.0

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`."""
        decision = self.policy.act(view, sample=sample, generator=generator, activations=activations)
        if self.other is not None:
            mine, theirs = decision.distribution, self.other.act(view, sample=False).distribution
            assert mine is not None
            assert theirs is not None
            # rounding leaves -1e-9 between policies that are nearly the same
            self.divergence = mine.kl(theirs).double().clamp(min=0).cpu().numpy() / math.log(2)
        return decision


def play_compared(
    run: RunDir,
    path: Path,
    follower: Path | None,
    games: int,
    seed: int,
    threads: int,
    plugins: PluginRegistry,
) -> ComparedGames:
    """Play once in each of ``games`` parallel games.

    Args:
        run: of the adversaries.
        path: the checkpoint that plays.
        follower: the checkpoint it is compared with; ``None``: the divergence is 0.
        games: number of games.
        seed: of all draws, the same for both checkpoints' stochastic hooks.
        threads: physics threads (0: all CPUs); never changes the result.
        plugins: registry with the run's game and methods.
    """

    def load(checkpoint: Path, num_envs: int) -> Pairing:
        return load_pairing(
            run.path,
            num_envs=num_envs,
            seed=seed,  # stochastic hooks of both draw the same
            threads=threads,
            plugins=plugins,
            adversary_actions="sample",
            victim_actions=run.config().victim_actions,
            checkpoint_path=checkpoint,
        )

    with load(path, games) as pairing, pairing.attribution():
        if follower is None:
            return _games(pairing, None, seed, plugins)
        with load(follower, 1) as other, other.attribution():
            return _games(pairing, other.adversary, seed, plugins)


@torch.inference_mode()
def _games(pairing: Pairing, other: Policy | None, seed: int, plugins: PluginRegistry) -> ComparedGames:
    config, game, side = pairing.config, pairing.game, pairing.side
    weights = resolve_weights(config.reward, game_spec(config.env, plugins).rewards)
    share = dense_share(config, weights, pairing.steps or 0)
    players, compared = pairing.players(seed), ComparedPolicy(pairing.adversary, other)
    seats = [replace(seat, policy=compared) if i == side else seat for i, seat in enumerate(players.seats)]
    players = replace(players, seats=(seats[0], seats[1]))
    game.seed(stream_seed(seed, "evaluation games"))
    games, active = players.start(game), np.ones(game.num_envs, bool)
    playing, rewards, divergence = [], [], []
    while active.any():
        step = games.step(players.act(games), None if active.all() else active)
        playing.append(active)
        rewards.append(np.where(active, training_reward(step, weights, share)[1 - side], 0.0))
        divergence.append(np.broadcast_to(compared.divergence, active.shape))
        active = active & ~step.done
    return ComparedGames(
        pairing.steps or 0, config.ppo.gamma, np.array(playing), np.array(rewards), np.array(divergence)
    )
