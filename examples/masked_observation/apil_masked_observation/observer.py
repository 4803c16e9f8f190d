"""The masked observation's hook and its running means."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from apil_core import ConfigError, Context, MethodSetup, Observer, RunningMoments, hookimpl
from apil_masked_observation.options import MaskedObservationOptions


class MaskedObservation(Observer):
    """Replaces the columns M of the victim's observation that describe its opponent."""

    options: MaskedObservationOptions

    def __init__(self, options: MaskedObservationOptions, setup: MethodSetup):
        super().__init__(options, setup)
        channels = setup.victim.opponent_channels
        if not channels:
            raise ConfigError(
                f"nothing to mask: the game does not say which channels of the {setup.victim.name}'s "
                "observation tell about its opponent (SideLayout.opponent_channels)"
            )
        self.channels = torch.tensor(channels, device=setup.device)
        self.usual = RunningMoments(len(channels)).to(setup.device)

    @hookimpl
    def filter_observation(self, context: Context, obs: Tensor) -> Tensor | None:
        """Mask the opponent in the victim's observation (n, o); return ``None`` for the adversary's.

        Raises:
            ConfigError: ``way`` is ``mean``, and no training has recorded means.
        """
        if context.role != "victim":
            return None
        return obs.index_copy(1, self.channels, self._instead(context, obs[:, self.channels]))

    def _instead(self, context: Context, hidden: Tensor) -> Tensor:
        """Values that replace ``hidden`` in the victim's observation, (n, k)."""
        way = self.options.way
        if way == "noise":
            return torch.empty_like(hidden).normal_(generator=context.generator)
        if way == "dropout":
            drawn = hidden.new_empty(len(hidden), 1).uniform_(generator=context.generator)
            return hidden * (drawn >= self.options.share)
        if way == "mean":
            if context.mode == "train":  # evaluations must not change the training's means
                self.usual.update(hidden)
            elif not self.usual.count:
                raise ConfigError(
                    "masked_observation: way mean needs a run that was trained with it: it has no means"
                )
            return self.usual.mean.to(hidden.dtype).expand_as(hidden)
        return torch.zeros_like(hidden)

    def state_dict(self) -> dict[str, Any]:
        """Return the means."""
        return {"usual": self.usual.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the means."""
        self.usual.load_state_dict(state["usual"])
