"""The training reward of both sides from the game's sparse and dense parts (docs/methods.md §1)."""

from __future__ import annotations

from apil_core.api.config import RewardConfig, RunConfig
from apil_core.api.game import Array, GameStep
from apil_core.api.specs import RewardWeights


def resolve_weights(config: RewardConfig, game: RewardWeights) -> RewardWeights:
    """The game's weights, overridden where the config gives a value."""
    return RewardWeights(
        dense_weight=game.dense_weight if config.dense_weight is None else config.dense_weight,
        sparse_weight=game.sparse_weight if config.sparse_weight is None else config.sparse_weight,
        anneal_fraction=game.anneal_fraction if config.anneal_fraction is None else config.anneal_fraction,
    )


def annealing(weights: RewardWeights, steps: int, total_steps: int) -> float:
    """The dense share c after ``steps`` of ``total_steps`` environment steps: linear from 1 to 0."""
    span = weights.anneal_fraction * total_steps
    return max(0.0, 1.0 - steps / span) if span > 0 else 0.0


def dense_share(config: RunConfig, weights: RewardWeights, steps: int) -> float:
    """:func:`annealing` over the run's budget, or over the fixed one that ``reward.anneal_budget`` names."""
    return annealing(weights, steps, config.reward.anneal_budget or config.steps)


def training_reward(step: GameStep, weights: RewardWeights, c: float) -> Array:
    """``c · w_dense · dense + (1 − c) · w_sparse · sparse`` per side, shape (2, num_envs).

    ``dense`` is the game's shaping stream.
    """
    reward = step.sparse * ((1.0 - c) * weights.sparse_weight)
    if c > 0.0:
        reward = reward + step.shaping * (c * weights.dense_weight)
    return reward
