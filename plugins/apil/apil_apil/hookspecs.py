"""The hook APIL opens to methods that build on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core import hookspec

if TYPE_CHECKING:
    from torch import Tensor

    from apil_core import Rollout, Run


@hookspec(firstresult=True)
def imitation_reward(run: Run, rollout: Rollout, logits: Tensor) -> Tensor | None:
    """The imitator's reward per step, before its policy-gradient update.

    APIL answers with log D(s, ã) or −log(1 − D). Wrap it (``@hookimpl(wrapper=True)``) to add to
    that, as E-APIL does; implement it to replace it.

    Args:
        run: the run.
        rollout: the steps the imitator learns from.
        logits: of D at (s, ã), shape (T, n): D = σ(logits).

    Returns:
        rewards, shape (T, n), float32.
    """
