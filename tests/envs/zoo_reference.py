"""The zoo agents in plain numpy, written apart from the package as a check (docs/games.md, "Zoo weights").

Everything is batched: observations are (n, o), actions (n, a), recurrent state (n, 128).
"""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np

HIDDEN = 128
WIDTH = 64
CLIP = 5.0


def load_flat(path: Path | str) -> np.ndarray:
    """One flat float32 vector of all parameters. For the trusted files of the zoo only: it unpickles."""
    with open(path, "rb") as file:
        return np.asarray(pickle.load(file, encoding="latin1"), np.float32).ravel()


class _Reader:
    """Cuts arrays off the front of a vector."""

    def __init__(self, flat: np.ndarray):
        self.flat = np.asarray(flat, np.float32)
        self.at = 0

    def take(self, *shape: int) -> np.ndarray:
        size = int(np.prod(shape))
        part = self.flat[self.at : self.at + size]
        assert part.size == size, "the vector is too short"
        self.at += size
        return part.reshape(shape)

    def dense(self, inputs: int, outputs: int) -> tuple[np.ndarray, np.ndarray]:
        return self.take(inputs, outputs), self.take(outputs)


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-x))


class _Reference:
    """What both kinds of net share: the filters in front, logstd behind, and the draw of actions."""

    def __init__(self, flat: np.ndarray, obs_dim: int, act_dim: int):
        reader = _Reader(flat)
        reader.take(3)  # the return filter
        total, squares, count = reader.take(obs_dim), reader.take(obs_dim), reader.take(1)
        self.obs_mean = total / count
        self.obs_std = np.sqrt(np.maximum(squares / count - self.obs_mean**2, 1e-2))
        self._value = self._net(reader, obs_dim, 1)
        self._policy = self._net(reader, obs_dim, act_dim)
        self.logstd = reader.take(act_dim)
        assert reader.at == reader.flat.size, f"{reader.flat.size - reader.at} numbers left over"

    def _net(self, reader: _Reader, inputs: int, outputs: int) -> list[tuple[np.ndarray, np.ndarray]]:
        raise NotImplementedError

    def mean(self, obs: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def normalised(self, obs: np.ndarray) -> np.ndarray:
        return np.clip((obs - self.obs_mean) / self.obs_std, -CLIP, CLIP)

    def act(self, obs: np.ndarray, rng: np.random.Generator | None = None) -> np.ndarray:
        """Draw actions with ``rng``, or take the mean without; advances the recurrent state once."""
        mean = self.mean(obs)
        if rng is None:
            return mean
        return mean + np.exp(self.logstd) * rng.standard_normal(mean.shape, np.float32)

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the past of the games in ``mask`` (n,) (all games if ``None``)."""


class ReferenceLSTM(_Reference):
    """Kick-and-defend and sumo: ReLU layer, LSTM cell (gates i, j, f, o; forget bias 1), linear layer."""

    def __init__(self, flat: np.ndarray, obs_dim: int, act_dim: int):
        super().__init__(flat, obs_dim, act_dim)
        self._c = self._h = np.zeros((0, HIDDEN), np.float32)

    def _net(self, reader: _Reader, inputs: int, outputs: int) -> list[tuple[np.ndarray, np.ndarray]]:
        return [
            reader.dense(inputs, HIDDEN),
            reader.dense(2 * HIDDEN, 4 * HIDDEN),
            reader.dense(HIDDEN, outputs),
        ]

    def mean(self, obs: np.ndarray) -> np.ndarray:
        """Mean action; each call is one time step of the recurrent state."""
        if len(self._c) != len(obs):
            self._c = self._h = np.zeros((len(obs), HIDDEN), np.float32)
        (w1, b1), (w2, b2), (w3, b3) = self._policy
        x = np.maximum(self.normalised(obs) @ w1 + b1, 0)
        i, j, f, o = np.split(np.concatenate([x, self._h], 1) @ w2 + b2, 4, axis=1)
        self._c = _sigmoid(f + 1) * self._c + _sigmoid(i) * np.tanh(j)
        self._h = _sigmoid(o) * np.tanh(self._c)
        return self._h @ w3 + b3

    def reset(self, mask: np.ndarray | None = None) -> None:
        keep = 0.0 if mask is None else (~mask[:, None]).astype(np.float32)
        self._c, self._h = self._c * keep, self._h * keep


class ReferenceMLP(_Reference):
    """You-shall-not-pass and run-to-goal: two tanh layers of 64, linear layer."""

    def _net(self, reader: _Reader, inputs: int, outputs: int) -> list[tuple[np.ndarray, np.ndarray]]:
        return [reader.dense(inputs, WIDTH), reader.dense(WIDTH, WIDTH), reader.dense(WIDTH, outputs)]

    def mean(self, obs: np.ndarray) -> np.ndarray:
        """Mean action."""
        (w1, b1), (w2, b2), (w3, b3) = self._policy
        return np.tanh(np.tanh(self.normalised(obs) @ w1 + b1) @ w2 + b2) @ w3 + b3
