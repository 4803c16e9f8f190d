"""How a retraining's games end, by opponent; all from the victim's point of view."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from apil_core.training.episode_stats import WINDOW

MIXED = "mixed"
"""Label of games in which opponents change from step to step."""


class OpponentTally:
    """Outcomes of the last games against each opponent, and what ended since it was last asked.

    Args:
        labels: of the opponents.
        causes: names of endings.
        games: played together.
    """

    def __init__(self, labels: Sequence[str], causes: Sequence[str], games: int):
        self.labels = list(labels)
        self.causes = list(causes)
        self.games_total = 0
        self._windows: list[list[int]] = [[] for _ in labels]
        self._window_causes: list[list[int]] = [[] for _ in labels]
        self._returns = torch.zeros(games, dtype=torch.float64)
        self._clear()

    def add(self, reward: Tensor, done: Tensor) -> None:
        """Take in a step's rewards as the game gives them, (n,), and which games end with it, (n,) bool."""
        self._returns += reward.cpu()
        if bool(done.any()):
            ended = done.cpu()
            self._sum += float(self._returns[ended].sum())
            self._returns[ended] = 0.0

    def ended(
        self, opponents: Sequence[int], outcomes: Sequence[int], causes: Sequence[int], lengths: Sequence[int]
    ) -> None:
        """Take in ended games.

        Args:
            opponents: index of whom each was played against.
            outcomes: +1 the victim won, −1 it lost, 0 a tie.
            causes: index of the ending.
            lengths: steps.
        """
        for opponent, outcome, cause in zip(opponents, outcomes, causes, strict=True):
            self._windows[opponent].append(outcome)
            self._window_causes[opponent].append(cause)
        self._windows = [window[-WINDOW:] for window in self._windows]
        self._window_causes = [window[-WINDOW:] for window in self._window_causes]
        self.games_total += len(outcomes)
        self._games += len(outcomes)
        self._length += sum(lengths)
        self._causes.update(causes)

    def metrics(self) -> dict[str, float]:
        """Windows of the last 1000 games each, and what happened since the last call."""
        every = [outcome for window in self._windows for outcome in window]
        found: dict[str, float] = {
            "games": self._games,
            "games_total": self.games_total,
            "window_games": len(every),
            "window_wins": every.count(1),
            "window_ties": every.count(0),
            "window_losses": every.count(-1),
        }
        if self._games:
            found |= {
                "return/victim": self._sum / self._games,
                "episode_length": self._length / self._games,
            }
        for label, window in zip(self.labels, self._windows, strict=True):
            found[f"opponent/{label}/games"] = len(window)
            found[f"opponent/{label}/wins"] = window.count(1)
            found[f"opponent/{label}/ties"] = window.count(0)
        found |= {f"cause/{name}": self._causes[i] for i, name in enumerate(self.causes)}
        lately = Counter(cause for window in self._window_causes for cause in window)
        found |= {f"window_cause/{name}": lately[i] for i, name in enumerate(self.causes)}
        self._clear()
        return found

    def _clear(self) -> None:
        self._games = 0
        self._sum = 0.0
        self._length = 0
        self._causes: Counter[int] = Counter()

    def state_dict(self) -> dict[str, Any]:
        """State at an iteration boundary."""
        windows = [torch.tensor(window, dtype=torch.int8) for window in self._windows]
        causes = [torch.tensor(window, dtype=torch.int16) for window in self._window_causes]
        return {
            "games_total": self.games_total,
            "windows": windows,
            "window_causes": causes,
            "returns": self._returns.clone(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`state_dict` gave."""
        self.games_total = state["games_total"]
        self._windows = [window.tolist() for window in state["windows"]]
        causes = state.get("window_causes")  # checkpoints from before they were kept have none
        self._window_causes = [[] for _ in self.labels] if causes is None else [w.tolist() for w in causes]
        self._returns.copy_(state["returns"])
