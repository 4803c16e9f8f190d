"""What a side gets to see once the run's ``filter_observation`` hooks have had their say."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from apil_core.run_hooks import RunHookManager
from apil_core.types import Context


class ObservationFilter:
    """Asks the hooks, if any plugin fills them, and checks what they return; the same in training and play.

    Args:
        hooks: of the adversary's run, or ``None`` where there is no run.
        contexts: for whom each side's observation is, by side.
    """

    def __init__(self, hooks: RunHookManager | None, contexts: Mapping[int, Context]):
        self._hooks = hooks if hooks is not None and hooks.fills("filter_observation") else None
        self._contexts = contexts

    def __call__(self, side: int, observation: Tensor) -> Tensor:
        """What ``side`` sees of its observation, shape (n, o) as before.

        Raises:
            PluginError: a hook returned something else.
        """
        if self._hooks is None:
            return observation
        context = self._contexts[side]
        filtered = self._hooks.hook.filter_observation(context=context, side=side, obs=observation)
        if filtered is None:
            return observation
        return self._hooks.checked("filter_observation", "", filtered, tuple(observation.shape))
