"""Small victims that can be trained, made on the spot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from apil_core.api.policy import PolicyInfo
from apil_core.api.types import View
from apil_core.policies.network import NetworkShape, PolicyNetwork
from apil_core.policies.student import save_policy
from apil_core.policies.zoo_catalogue import GameFacts
from apil_core.policies.zoo_layout import tensor_shapes
from apil_core.policies.zoo_policy import ZooPolicy


def student(path: Path, kind: Any = "lstm", seed: int = 0, scale: float = 1.0) -> str:
    """An untrained evader of toy-pursuit in a file; its name."""
    torch.manual_seed(seed)
    width, hidden, embed = (8, (), 6) if kind == "lstm" else (0, (16,), 0)
    shape = NetworkShape(kind, 7, 2, width, hidden, 3.0, embed)
    weights = {name: scale * tensor for name, tensor in PolicyNetwork(shape).state_dict().items()}
    weights |= {"observation.mean": torch.randn(7) / 4, "observation.std": torch.rand(7) / 2 + 0.5}
    save_policy(path, shape, {**weights, "log_std": torch.tensor([-1.0, -0.5])}, {})
    return f"safetensors:{path}"


def runner(path: Path, towards: str, speed: float) -> str:
    """A player of toy-pursuit in a file that runs at the ``"gate"`` or at its ``"opponent"``; its name.

    A share ``speed`` of full speed. The rest of its 32 units are there to learn with.
    """
    torch.manual_seed(0)
    shape = NetworkShape("mlp", 7, 2, 0, (32,), 5.0, 0)
    weights = PolicyNetwork(shape).state_dict()
    where = {"opponent": 2, "gate": 4}[towards]  # of its relative position in the observation
    weights["mlp.0.weight"][:2] = 4 * torch.eye(7)[where : where + 2]
    weights["mlp.0.bias"][:2] = 0
    weights["mlp.1.weight"].copy_(speed * torch.eye(2, 32))
    weights["mlp.1.bias"].zero_()
    weights |= {"observation.mean": torch.zeros(7), "observation.std": torch.ones(7)}
    save_policy(path, shape, {**weights, "log_std": torch.full((2,), -1.0)}, {})
    return f"safetensors:{path}"


def zoo_agent(*, recurrent: bool) -> ZooPolicy:
    """An agent with the zoo's layout and random weights."""
    random = np.random.default_rng(0)
    shapes = tensor_shapes(GameFacts(9, 3, recurrent=recurrent))
    weights = {name: random.normal(0, 0.3, shape).astype(np.float32) for name, shape in shapes.items()}
    for name in ("observation_filter", "return_filter"):
        weights[f"{name}.count"] = np.float32(50)
        weights[f"{name}.sum"] = (50 * random.normal(0, 1, shapes[f"{name}.sum"])).astype(np.float32)
        weights[f"{name}.sumsq"] = (50 * random.uniform(2, 9, shapes[f"{name}.sum"])).astype(np.float32)
    return ZooPolicy(PolicyInfo("zoo:test", "0" * 64, 9, 3), weights)


def views(steps: int, games: int, size: int, seed: int = 1) -> list[View]:
    """Observations of games that end now and then, at a time of their own."""
    generator = torch.Generator().manual_seed(seed)
    first = torch.rand(steps, games, generator=generator) < 0.2
    first[0] = True
    seen = 2 * torch.randn(steps, games, size, generator=generator)
    return [View(own, own, start) for own, start in zip(seen, first, strict=True)]
