"""The run's environment with the seats swapped: the victim learns, its opponents are frozen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from apil_core.api.types import OWN_GROUP, Context, StepBatch, View
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.policies.network import Standardizer
from apil_core.runs.retraining.mixture import MixturePolicy
from apil_core.training.adversary import ObservationBuilder
from apil_core.training.episode_stats import WINDOW, EpisodeStats

_SWAPPED = {"adversary": "victim", "victim": "adversary"}


class FixedObservations(ObservationBuilder):
    """The victim's observation, standardised by the fixed statistics of its own training.

    Updating them would change the victim's behaviour without a gradient step.
    """

    def __init__(self, hooks: RunHookManager, standardize: Standardizer):
        super().__init__(hooks, standardize.clip)
        self.standardize = standardize

    @property
    def sizes(self) -> dict[str, int]:
        """Length of the one group."""
        return {OWN_GROUP: self.standardize.mean.numel()}

    def groups(self, context: Context, view: View) -> dict[str, Tensor]:
        """See :meth:`ObservationBuilder.groups`."""
        return {OWN_GROUP: view.own}

    def normalize(self, groups: dict[str, Tensor], *, update: bool) -> TensorDict:
        """See :meth:`ObservationBuilder.normalize`."""
        own = self.standardize(groups[OWN_GROUP])
        return TensorDict({OWN_GROUP: own}, batch_size=[len(own)], device=own.device)


class OpponentStats(EpisodeStats):
    """Results of the games, in total and by opponent, all from the victim's point of view.

    Args:
        opponents: the mixture; its ``turn`` has the opponent of each game.
        labels: of the opponents, or of all together.
        num_envs, causes, device: as for :class:`EpisodeStats`.
    """

    def __init__(
        self,
        opponents: MixturePolicy,
        labels: Sequence[str],
        num_envs: int,
        causes: tuple[str, ...],
        device: torch.device,
    ):
        super().__init__(num_envs, causes, device)
        self._opponents = opponents
        self._by_opponent: dict[str, list[int]] = {label: [] for label in labels}

    def _end(self, step: StepBatch) -> None:
        labels = list(self._by_opponent)
        turns = self._opponents.turn[step.done].tolist() if len(labels) > 1 else [0] * int(step.done.sum())
        for turn, outcome in zip(turns, step.outcome[step.done].tolist(), strict=True):
            self._by_opponent[labels[turn]].append(outcome)
        self._by_opponent = {label: window[-WINDOW:] for label, window in self._by_opponent.items()}
        super()._end(step)

    def metrics(self) -> dict[str, float]:
        """Metrics of :class:`EpisodeStats`, the victim being the learner, and windows by opponent."""
        found: dict[str, float] = {}
        for name, value in super().metrics().items():
            group, _, last = name.rpartition("/")
            found[f"{group}/{_SWAPPED[last]}" if last in _SWAPPED else name] = value
        windows = self._by_opponent.values()
        found["window_games"] = sum(map(len, windows))
        for key, outcome in (("wins", 1), ("ties", 0), ("losses", -1)):
            found[f"window_{key}"] = sum(window.count(outcome) for window in windows)
        for label, window in self._by_opponent.items():
            found[f"opponent/{label}/games"] = len(window)
            found[f"opponent/{label}/wins"] = window.count(1)
            found[f"opponent/{label}/ties"] = window.count(0)
        return found

    def state_dict(self) -> dict[str, Any]:
        """Return the state at an iteration boundary."""
        windows = {
            label: torch.tensor(window, dtype=torch.int8) for label, window in self._by_opponent.items()
        }
        return {**super().state_dict(), "by_opponent": windows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`state_dict` returned."""
        super().load_state_dict(state)
        self._by_opponent = {label: window.tolist() for label, window in state["by_opponent"].items()}
