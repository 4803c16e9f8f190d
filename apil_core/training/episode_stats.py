"""Statistics of ended games during training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from apil_core.api.types import StepBatch

WINDOW = 1000
"""Number of last ended games that the running rates cover."""


class EpisodeStats:
    """Outcomes, returns and lengths of ended games, from the adversary's point of view.

    Returns are sums of the game's reward, sparse and dense; not of the training reward.

    Args:
        num_envs: number of games.
        causes: names of endings.
        device: where step tensors live.
    """

    def __init__(self, num_envs: int, causes: tuple[str, ...], device: torch.device):
        self.causes = causes
        self.games_total = 0
        self._returns = torch.zeros(2, num_envs, dtype=torch.float64, device=device)
        self._length = torch.zeros(num_envs, dtype=torch.int64, device=device)
        self._window: list[int] = []
        self._window_causes: list[int] = []
        self._clear()

    def add(self, step: StepBatch, terms: Mapping[str, Tensor]) -> None:
        """Add one vectorised step and its named reward terms, each (n,)."""
        self._returns += step.sparse + step.dense
        self._length += 1
        self._steps += 1
        self._uneven += (step.reward + step.victim_reward).abs().gt(1e-6).float().mean()
        for name, value in terms.items():
            self._terms[name] = self._terms.get(name, 0.0) + value.mean()
        if step.done.any():
            self._end(step)

    def _end(self, step: StepBatch) -> None:
        done = step.done
        outcomes = step.outcome[done].tolist()
        self.games_total += len(outcomes)
        self._window = (self._window + outcomes)[-WINDOW:]
        causes = step.cause[done].long().cpu()
        self._window_causes = (self._window_causes + causes.tolist())[-WINDOW:]
        self._cause_counts += torch.bincount(causes, minlength=len(self.causes))
        self._ended.append(torch.cat([self._returns[:, done], self._length[done].unsqueeze(0)]).cpu())
        self._returns[:, done] = 0.0
        self._length[done] = 0

    def metrics(self) -> dict[str, float]:
        """Metrics since the last call (docs/metrics.md), and the running window."""
        ended = torch.cat(self._ended, dim=1) if self._ended else torch.zeros(3, 0)
        result: dict[str, float] = {
            "games": ended.shape[1],
            "games_total": self.games_total,
            "window_games": len(self._window),
            "window_wins": self._window.count(1),
            "window_ties": self._window.count(0),
            "window_losses": self._window.count(-1),
            "reward/uneven_share": float(self._uneven) / max(self._steps, 1),
        }
        if ended.shape[1]:
            result["return/adversary"], result["return/victim"], result["episode_length"] = ended.mean(
                1
            ).tolist()
        for name, total in self._terms.items():
            result[f"reward/{name}"] = float(total) / max(self._steps, 1)
        for i, (name, count) in enumerate(zip(self.causes, self._cause_counts.tolist(), strict=True)):
            result[f"cause/{name}"] = count
            result[f"window_cause/{name}"] = self._window_causes.count(i)
        self._clear()
        return result

    def _clear(self) -> None:
        self._steps = 0
        self._uneven: Tensor | float = 0.0
        self._terms: dict[str, Tensor | float] = {}
        self._cause_counts = torch.zeros(len(self.causes), dtype=torch.int64)
        self._ended: list[Tensor] = []

    def state_dict(self) -> dict[str, Any]:
        """State at an iteration boundary."""
        return {
            "games_total": self.games_total,
            "returns": self._returns.clone(),
            "length": self._length.clone(),
            "window": torch.tensor(self._window, dtype=torch.int8),
            "window_causes": torch.tensor(self._window_causes, dtype=torch.int16),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        self.games_total = state["games_total"]
        self._returns.copy_(state["returns"])
        self._length.copy_(state["length"])
        self._window = state["window"].tolist()
        causes = state.get("window_causes")  # older checkpoints lack them
        self._window_causes = [] if causes is None else causes.tolist()
