"""Random network distillation (Burda et al. 2019): prediction error as a novelty bonus."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from apil_core import ReturnNormalizer, mlp
from apil_cva.config import CuriosityConfig
from apil_cva.training import ADAM_EPSILON, descend, minibatches


class Curiosity(nn.Module):
    """A frozen random network f and the network f̂ that learns to predict it.

    Args:
        input_size: length of both networks' input.
        config: layers, training and normalisation.
        gamma: discount of the return whose spread is the bonus's unit.
        device: of the networks.
    """

    def __init__(self, input_size: int, config: CuriosityConfig, gamma: float, device: torch.device):
        super().__init__()
        self.config = config
        self.gamma = gamma
        self.device = device
        sizes = (input_size, *config.hidden, config.features)
        self.target = mlp(sizes).to(device).requires_grad_(False)
        self.predictor = mlp(sizes).to(device)
        self.optimizer = torch.optim.Adam(self.predictor.parameters(), config.learning_rate, eps=ADAM_EPSILON)
        self.normalizer: ReturnNormalizer | None = None

    @torch.no_grad()
    def bonus(self, inputs: Tensor) -> Tensor:
        """½ · mean over the features of (f̂ − f)², (..., i) → (...,)."""
        error: Tensor = self.predictor(inputs) - self.target(inputs)
        return 0.5 * error.square().mean(-1)

    def normalized(self, bonus: Tensor, done: Tensor) -> Tensor:
        """``bonus`` (T, n) divided by the running standard deviation of its discounted return, (T, n).

        Args:
            bonus: of the rollout's steps.
            done: (T, n), ends of games, at which the return restarts.
        """
        if not self.config.normalize:
            return bonus
        normalizer = self._normalizer(bonus.shape[1])
        for row, ends in zip(bonus, done, strict=True):
            normalizer.update(row, ends)
        result: Tensor = normalizer(bonus)
        return result

    def learn(self, inputs: Tensor, parts: int, generator: torch.Generator) -> float:
        """Train the predictor for some epochs on a random share of ``inputs`` (m, i); return the mean loss.

        Args:
            inputs: of the rollout's steps.
            parts: minibatches per epoch.
            generator: of their choice and order.
        """
        count = max(int(len(inputs) * self.config.fraction), 1)
        chosen = torch.randperm(len(inputs), generator=generator, device=generator.device)[:count]
        inputs = inputs.index_select(0, chosen)
        with torch.no_grad():
            features = self.target(inputs)
        losses = []
        for rows in minibatches(count, parts, self.config.epochs, generator):
            error = self.predictor(inputs.index_select(0, rows)) - features.index_select(0, rows)
            loss = 0.5 * error.square().mean()
            losses.append(descend(loss, self.predictor, self.optimizer))
        return float(torch.stack(losses).mean())

    def training_state(self) -> dict[str, Any]:
        """Return both networks, the optimiser, and the bonus's statistics."""
        normalizer = self.normalizer
        return {
            "target": self.target.state_dict(),
            "predictor": self.predictor.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "normalizer": {} if normalizer is None else normalizer.state_dict(),
        }

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`training_state` returned."""
        self.target.load_state_dict(state["target"])
        self.predictor.load_state_dict(state["predictor"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.normalizer = None
        if state["normalizer"]:
            games = len(state["normalizer"]["returns"])
            self._normalizer(games).load_state_dict(state["normalizer"])

    def _normalizer(self, games: int) -> ReturnNormalizer:
        """The statistics for that many games; if the number changes, running returns start at zero."""
        old = self.normalizer
        if old is None or len(old.returns) != games:
            self.normalizer = ReturnNormalizer(games, self.gamma).to(self.device)
            if old is not None:
                self.normalizer.moments.load_state_dict(old.moments.state_dict())
        assert self.normalizer is not None
        return self.normalizer
