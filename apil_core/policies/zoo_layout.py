"""Division of a flat vector of the zoo into named tensors (docs/games.md, "Zoo weights").

In order: return filter (sum, sum of squares, count), observation filter (the same three), value net,
policy net, log standard deviation. Kernels are stored (inputs, outputs), as in TensorFlow.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import prod

import numpy as np
from numpy.typing import NDArray

from apil_core.policies.zoo_catalogue import GameFacts

Vector = NDArray[np.float32]
Shapes = dict[str, tuple[int, ...]]

LSTM_WIDTH = 128
MLP_WIDTH = 64


def tensor_shapes(facts: GameFacts) -> Shapes:
    """Names and shapes of an agent's tensors, in the order of the flat vector."""
    observation, action = facts.observation_size, facts.action_size
    shapes: Shapes = {
        "return_filter.sum": (),
        "return_filter.sumsq": (),
        "return_filter.count": (),
        "observation_filter.sum": (observation,),
        "observation_filter.sumsq": (observation,),
        "observation_filter.count": (),
    }
    network = _lstm if facts.recurrent else _mlp
    shapes |= network("value", observation, 1)
    shapes |= network("policy", observation, action)
    return shapes | {"logstd": (1, action)}


def _dense(name: str, inputs: int, outputs: int) -> Shapes:
    return {f"{name}.kernel": (inputs, outputs), f"{name}.bias": (outputs,)}


def _lstm(net: str, inputs: int, outputs: int) -> Shapes:
    return (
        _dense(f"{net}.embed", inputs, LSTM_WIDTH)
        | _dense(f"{net}.lstm", 2 * LSTM_WIDTH, 4 * LSTM_WIDTH)
        | _dense(f"{net}.out", LSTM_WIDTH, outputs)
    )


def _mlp(net: str, inputs: int, outputs: int) -> Shapes:
    return (
        _dense(f"{net}.hidden_0", inputs, MLP_WIDTH)
        | _dense(f"{net}.hidden_1", MLP_WIDTH, MLP_WIDTH)
        | _dense(f"{net}.out", MLP_WIDTH, outputs)
    )


def vector_length(facts: GameFacts) -> int:
    """Number of floats an agent of such a game has."""
    return sum(prod(shape) for shape in tensor_shapes(facts).values())


def split(vector: Vector, shapes: Shapes) -> dict[str, Vector]:
    """Split ``vector`` (length: :func:`vector_length`) into named views."""
    ends = np.cumsum([prod(shape) for shape in shapes.values()])
    parts = np.split(vector, ends[:-1])
    return {name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)}


def join(tensors: Mapping[str, Vector], shapes: Shapes) -> Vector:
    """The inverse of :func:`split`."""
    return np.concatenate([tensors[name].reshape(-1) for name in shapes])
