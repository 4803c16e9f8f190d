"""Observations after the run's ``filter_observation`` hooks."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from apil_core.api.types import Context
from apil_core.plugins.hook_manager import RunHookManager


class ObservationFilter:
    """The filters one after the other, each given what the last one left; the same in training and play.

    Args:
        hooks: of the adversary's run, or ``None`` where there is no run.
        contexts: for whom each side's observation is, by side.

    Raises:
        PluginError: a plugin wraps the hook.
    """

    def __init__(self, hooks: RunHookManager | None, contexts: Mapping[int, Context]):
        self._hooks = hooks
        self._filters = {} if hooks is None else hooks.callers("filter_observation")
        self._contexts = contexts

    def __call__(self, side: int, observation: Tensor) -> Tensor:
        """Filter an observation of ``side``, shape (n, o) as before.

        Raises:
            PluginError: a hook returned something else.
        """
        for name, ask in self._filters.items():
            for filtered in ask(context=self._contexts[side], side=side, obs=observation):
                assert self._hooks is not None
                shape = tuple(observation.shape)
                observation = self._hooks.checked("filter_observation", "", filtered, shape, by=name)
        return observation
