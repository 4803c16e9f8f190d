"""A matrix of small runs on the toy game, shared by tests."""

from __future__ import annotations

from typing import Any

from apil_core.bench.matrix import Matrix


def small_matrix(**changes: Any) -> Matrix:
    """ADRL, one seed, six iterations, 20 games of scoring."""
    base: dict[str, Any] = {
        "methods": ["adrl"],
        "games": ["toy-pursuit"],
        "steps": 6 * 512,
        "config": {
            "num_envs": 32,
            "ppo": {"num_steps": 16, "epochs": 2, "minibatches": 2},
            "evaluation": {"episodes": 0},
            "checkpoint": {"every_iterations": 1},
            "recorders": ["jsonl"],
        },
        "scores": {"plain": {"episodes": 20}},
    }
    return Matrix(**{**base, **changes})
