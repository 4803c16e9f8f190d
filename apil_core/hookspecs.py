"""Every hook of the core. A hook implementation takes only the arguments it names.

``ProcessHooks`` are asked once per process, ``RunHooks`` during one run (training or evaluation).
Shapes: ``n`` is ``num_envs``, ``T`` the rollout length.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core.hooks import hookspec

if TYPE_CHECKING:
    from torch import Tensor

    from apil_core.method import Run
    from apil_core.specs import GameSpec, MethodSpec, PolicySpec, RecorderSpec
    from apil_core.types import Context, Rollout, StepBatch, View


class ProcessHooks:
    """Asked once, when plugins are discovered. Implementations must not import torch or mujoco."""

    @hookspec
    def register_methods(self) -> list[MethodSpec]:  # type: ignore[empty-body]
        """Attack methods this plugin offers."""

    @hookspec
    def register_games(self) -> list[GameSpec]:  # type: ignore[empty-body]
        """Games this plugin offers."""

    @hookspec
    def register_policies(self) -> list[PolicySpec]:  # type: ignore[empty-body]
        """Families of policies (victims) this plugin can load."""

    @hookspec
    def register_recorders(self) -> list[RecorderSpec]:  # type: ignore[empty-body]
        """Sinks for metrics this plugin offers."""


class RunHooks:
    """Called during a run, on the chosen method, what it requires, and switched-on observers."""

    @hookspec
    def run_started(self, run: Run) -> None:
        """Everything is built; the first rollout has not begun (also after a resume)."""

    @hookspec
    def run_finished(self, run: Run) -> None:
        """The last iteration is over and its checkpoint written."""

    @hookspec
    def filter_observation(self, context: Context, side: int, obs: Tensor) -> Tensor | None:
        """Change what a side sees (noise, masking, defences); per vectorised step, before anyone acts.

        Filters follow one another in order of registration: required methods, the method, observers.

        Args:
            context: ``context.side`` equals ``side``.
            side: 0 or 1.
            obs: that side's observation as the last filter left it, shape (n, o); do not modify it.

        Returns:
            the observation the next filter or that side gets, shape (n, o), or ``None``: unchanged.
        """

    @hookspec
    def extend_observation(self, context: Context, view: View) -> dict[str, Tensor] | None:
        """Named extra observation groups for the adversary, once per observation.

        Works without a run: trained adversaries call it in evaluation, cross-play and video.

        Returns:
            ``{name: (n, k) float32}``; ``k`` must not change; names must be unique among plugins.
        """

    @hookspec
    def shape_reward(self, run: Run, step: StepBatch) -> dict[str, Tensor] | None:
        """Named terms added to r^α, in the units of docs/methods.md §1, each logged; per vectorised step.

        Returns:
            ``{name: (n,) float32}``.
        """

    @hookspec
    def finish_rollout(self, run: Run, rollout: Rollout) -> dict[str, Tensor] | None:
        """Named further reward streams, per rollout, before advantages.

        The learner owns one critic per stream, trained in its own optimiser.

        Returns:
            ``{name: (T, n) float32}``; a method returns the same names in every rollout.
        """

    @hookspec(firstresult=True)
    def combine_advantages(self, run: Run, rollout: Rollout, streams: dict[str, Tensor]) -> Tensor | None:
        """Mix the streams' advantages into the one the policy gradient uses.

        Args:
            streams: GAE per stream, each (T, n), not normalised; ``"reward"`` is the main one.

        Returns:
            (T, n), used as given (normalise per rollout here), or ``None`` for the main stream's.
        """

    @hookspec
    def update_auxiliary(self, run: Run, rollout: Rollout) -> dict[str, float] | None:
        """Train what else a method owns; per rollout, after advantages, before PPO.

        Returns:
            metrics, logged as ``<plugin>/<name>``.
        """

    @hookspec
    def iteration_finished(self, run: Run, metrics: dict[str, float]) -> None:
        """After every iteration; ``metrics`` is what the recorders get."""

    @hookspec
    def evaluation_finished(self, run: Run, result: dict[str, object]) -> None:
        """After a periodic or final evaluation; ``result`` is what ``apil eval --json`` prints."""
