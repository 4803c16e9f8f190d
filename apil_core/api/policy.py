"""The interface of a policy: it chooses one side's actions, batched over games."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import torch

from apil_core.api.types import Decision, View


@dataclass(frozen=True)
class PolicyInfo:
    """Identity of a policy, stored with every score.

    Attributes:
        name: full name, e.g. ``"zoo:kick-and-defend/kicker/v1"``, by which it can be loaded again (paths in
            it are absolute); a run stores it.
        sha256: of the weights the policy was made from.
        observation_size, action_size: what it reads and gives.
        provenance: origin, as text.
        action_bounds: lowest and highest action it was made for, if it says so; a seat must have the same.
    """

    name: str
    sha256: str
    observation_size: int
    action_size: int
    provenance: dict[str, str] = field(default_factory=dict)
    action_bounds: tuple[float, float] | None = None


class Policy(ABC):
    """A policy for one side, for training, evaluation, cross-play and video.

    The policy holds its recurrent state, one row per game; ``act`` clears the rows where ``view.first``.
    The number of games may change between calls only together with ``first`` all true.
    """

    info: PolicyInfo

    @abstractmethod
    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """Choose actions for every game.

        Args:
            view: see :class:`apil_core.View`.
            sample: draw from the distribution (true) or take its mode (false).
            generator: source of the draw; required for reproducible sampling.
            activations: also return the last hidden layer as ``activations["hidden"]``, (n, k).
        """

    def to(self, device: torch.device | str) -> Policy:
        """Move weights and state to ``device``; returns self."""
        return self

    def seed(self, seed: int) -> None:  # noqa: B027  (optional)
        """Reseed the policy's own random generators, if it has any beside :meth:`act`'s argument."""

    def recurrent_state(self) -> dict[str, Any]:
        """State carried between steps (empty for feed-forward policies), for exact resume.

        Tensors, numbers, strings and dicts of them; the generators that :meth:`seed` restarts included.
        """
        return {}

    def load_recurrent_state(self, state: dict[str, Any]) -> None:  # noqa: B027  (optional)
        """Restore the result of :meth:`recurrent_state`; an empty one resets all games."""
