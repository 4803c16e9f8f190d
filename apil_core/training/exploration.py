"""Exploration noise that is correlated in time (docs/methods.md §3, PPO).

White noise reverses a motor within milliseconds: its mean force is near zero. Noise that keeps its sign for
several steps has the same distribution at every single step but a larger net effect.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from apil_core.api.config import PPOConfig


def make_noise(
    config: PPOConfig, num_envs: int, action_size: int, horizon: int, device: torch.device
) -> Noise | None:
    """Build the noise that ``ppo.noise`` names; ``None`` for white noise, which has no state.

    Args:
        config: PPO's settings.
        num_envs, action_size: n and a.
        horizon: longest game, in steps.
        device: of the draws.
    """
    if config.noise == "white":
        return None
    if config.noise == "ar1":
        return AutoregressiveNoise(config.noise_correlation, num_envs, action_size, device)
    return ColouredNoise(config.noise_colour, num_envs, action_size, horizon, device)


class Noise:
    """Standard normal draws, one per step, game and action component, from torch's global generator."""

    def draw(self) -> Tensor:
        """The next step's, (n, a)."""
        raise NotImplementedError

    def renew(self, done: Tensor) -> None:
        """Reset the noise of ended games, (n,) bool."""
        raise NotImplementedError

    def state_dict(self) -> dict[str, Any]:
        """State that the next draws depend on, torch's generator aside."""
        raise NotImplementedError

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        raise NotImplementedError


class AutoregressiveNoise(Noise):
    """ε_t = ρ·ε_{t−1} + √(1 − ρ²)·fresh; the first ε of a game is fresh.

    Args:
        correlation: ρ of successive draws, in [0, 1).
        num_envs, action_size: n and a.
        device: of the draws.
    """

    def __init__(self, correlation: float, num_envs: int, action_size: int, device: torch.device):
        self._past = torch.zeros(num_envs, action_size, device=device)
        self._begun = torch.zeros(num_envs, 1, dtype=torch.bool, device=device)
        self._keep, self._fresh = correlation, math.sqrt(1 - correlation**2)

    def draw(self) -> Tensor:
        """See :meth:`Noise.draw`."""
        fresh = torch.randn_like(self._past)
        self._past = torch.where(self._begun, self._keep * self._past + self._fresh * fresh, fresh)
        self._begun = torch.ones_like(self._begun)
        return self._past

    def renew(self, done: Tensor) -> None:
        """See :meth:`Noise.renew`."""
        self._begun = self._begun & ~done.unsqueeze(-1)

    def state_dict(self) -> dict[str, Any]:
        """See :meth:`Noise.state_dict`."""
        return {"past": self._past, "begun": self._begun}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :meth:`Noise.load_state_dict`."""
        self._past = state["past"].to(self._past.device)
        self._begun = state["begun"].to(self._past.device)


class ColouredNoise(Noise):
    """Power spectrum 1/f^β over the longest game (Timmer & König 1995; Hollenstein et al. 2024: β = ½).

    A game's whole noise is drawn at its start; a game longer than the horizon draws again.

    Args:
        colour: β; 0 is white, 1 pink, 2 red.
        num_envs, action_size: n and a.
        horizon: longest game, in steps.
        device: of the draws.
    """

    def __init__(self, colour: float, num_envs: int, action_size: int, horizon: int, device: torch.device):
        self._length = horizon + horizon % 2
        frequency = torch.fft.rfftfreq(self._length, device=device)
        frequency[0] = frequency[1]  # the lowest one counts for the mean too
        self._amplitude = frequency.pow(-colour / 2)
        self._noise = torch.zeros(num_envs, action_size, self._length, device=device)
        self._step = torch.full((num_envs,), self._length, device=device)  # none is drawn yet

    def draw(self) -> Tensor:
        """See :meth:`Noise.draw`."""
        over = (self._step >= self._length).nonzero()[:, 0]
        if len(over):
            self._noise[over] = self._sequences(len(over))
            self._step[over] = 0
        games = torch.arange(len(self._step), device=self._step.device)
        drawn = self._noise[games, :, self._step]
        self._step += 1
        return drawn

    def _sequences(self, count: int) -> Tensor:
        """Noise of ``count`` games, (count, a, length), each value standard normal."""
        size = (count, self._noise.shape[1], len(self._amplitude))
        real, imaginary = torch.randn(2, *size, device=self._noise.device)
        # the mean and the highest frequency have no phase: as much power in the real part alone
        for edge in (0, -1):
            real[..., edge] *= math.sqrt(2)
            imaginary[..., edge] = 0
        inner = self._amplitude[1:-1].square().sum()
        edges = self._amplitude[0].square() + self._amplitude[-1].square()
        # variance of irfft's output: (1 / N²) · (2 · 2 · inner + 2 · edges)
        scale = self._length / torch.sqrt(4 * inner + 2 * edges)
        return torch.fft.irfft(torch.complex(real, imaginary) * self._amplitude, self._length) * scale

    def renew(self, done: Tensor) -> None:
        """See :meth:`Noise.renew`."""
        self._step = torch.where(done, self._length, self._step)

    def state_dict(self) -> dict[str, Any]:
        """See :meth:`Noise.state_dict`."""
        return {"noise": self._noise, "step": self._step}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :meth:`Noise.load_state_dict`."""
        self._noise = state["noise"].to(self._noise.device)
        self._step = state["step"].to(self._noise.device)
