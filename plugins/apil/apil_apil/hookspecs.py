"""The hooks APIL defines for methods that build on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core import hookspec

if TYPE_CHECKING:
    from torch import Tensor

    from apil_core import Rollout, Run


@hookspec(firstresult=True, since=1)
def imitation_reward(run: Run, rollout: Rollout, logits: Tensor) -> Tensor | None:
    """Reward APIL's imitator per step.

    APIL answers with log D(s, ã), −log(1 − D) or their sum. Wrap it (``@hookimpl(wrapper=True)``) to add
    to that; implement it to replace it. With ``credit: step`` each ã_t is rewarded for its own step only:
    rewards to be credited to earlier steps belong in ``imitation_streams``. With ``objective: likelihood``
    the reward is not used.

    When: once per iteration, after D's update and before the imitator's; beside PPO's update, so neither
        ``run.collect`` nor torch's global generator may be used.

    Args:
        run: the run.
        rollout: the ``Rollout`` the imitator learns from.
        logits: of D at each state and imitated action, (T, n): D = σ(logit).

    Returns:
        the imitator's reward, (T, n) float32.
    """


@hookspec(since=2)
def imitation_streams(run: Run, rollout: Rollout) -> dict[str, tuple[float, Tensor]] | None:
    """Reward APIL's imitator for later events in the game.

    Every stream has its own critic and is discounted by ``ppo.gamma`` and ``ppo.lam``. Its advantages,
    normalised over the rollout, are added with its weight to those of D's reward. With ``credit: return``
    there is one reward: D's plus weight × reward of each stream.

    When: once per iteration, before D's update.

    Args:
        run: the run.
        rollout: the ``Rollout`` the imitator learns from.

    Returns:
        ``{name: (weight, reward)}``, reward (T, n) float32, the same names in every rollout, or ``None``.
    """
