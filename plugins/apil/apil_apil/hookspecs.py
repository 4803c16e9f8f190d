"""The hook APIL opens to methods that build on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core import hookspec

if TYPE_CHECKING:
    from torch import Tensor

    from apil_core import Rollout, Run


@hookspec(firstresult=True, since=1)
def imitation_reward(run: Run, rollout: Rollout, logits: Tensor) -> Tensor | None:
    """Pay APIL's imitator, step by step.

    APIL answers with log D(s, ã) or −log(1 − D). Wrap it (``@hookimpl(wrapper=True)``) to add to
    that, as E-APIL does; implement it to replace it.

    When: once per iteration, before the imitator's policy-gradient update.

    Args:
        run: the run.
        rollout: the ``Rollout`` the imitator learns from.
        logits: of D at each state and imitated action, (T, n): D = σ(logit).

    Returns:
        the imitator's reward, (T, n) float32.
    """
