"""Observations after the run's ``filter_observation`` hooks."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from apil_core.api.types import Context
from apil_core.plugins.hook_manager import RunHookManager


class ObservationFilter:
    """Chain of the filters, each applied to the output of the last one; the same in training and evaluation.

    Args:
        hooks: of the adversary's run, or ``None`` where there is no run.
        contexts: of both sides' observations, by side.

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
