"""Every hook of the core. A hook implementation takes only the arguments it names.

``ProcessHooks`` are called once per process, ``RunHooks`` during one run (training or evaluation).
Shapes: ``n`` is ``num_envs``, ``T`` the rollout length. ``docs/make_hooks.py`` makes the tables of
docs/hooks.md from these docstrings: purpose, ``When`` the hook is called, arguments and return value.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core.api.hooks import hookspec

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

    from apil_core.api.method import Run
    from apil_core.api.specs import GameSpec, MethodSpec, ObserverSpec, PolicySpec, RecorderSpec
    from apil_core.api.types import Context, Rollout, StepBatch, View


class ProcessHooks:
    """Called once, when plugins are discovered. Implementations must not import torch or mujoco."""

    @hookspec(since=1)
    def register_methods(self) -> list[MethodSpec]:  # type: ignore[empty-body]
        """Offer attack methods.

        When: once per process, when plugins are discovered.

        Returns:
            a list of :class:`apil_core.MethodSpec`.
        """

    @hookspec(since=1)
    def register_observers(self) -> list[ObserverSpec]:  # type: ignore[empty-body]
        """Offer observers with their own options or state, such as defences.

        When: once per process, when plugins are discovered.

        Returns:
            a list of :class:`apil_core.ObserverSpec`.
        """

    @hookspec(since=1)
    def register_games(self) -> list[GameSpec]:  # type: ignore[empty-body]
        """Offer games.

        When: once per process, when plugins are discovered.

        Returns:
            a list of :class:`apil_core.GameSpec`.
        """

    @hookspec(since=1)
    def register_policies(self) -> list[PolicySpec]:  # type: ignore[empty-body]
        """Offer families of policies (victims) that can be loaded by name.

        When: once per process, when plugins are discovered.

        Returns:
            a list of :class:`apil_core.PolicySpec`.
        """

    @hookspec(since=1)
    def register_recorders(self) -> list[RecorderSpec]:  # type: ignore[empty-body]
        """Offer sinks for metrics.

        When: once per process, when plugins are discovered.

        Returns:
            a list of :class:`apil_core.RecorderSpec`.
        """


class RunHooks:
    """Called during a run, on the chosen method, what it requires, and switched-on observers."""

    @hookspec(since=1)
    def run_started(self, run: Run) -> None:
        """React to the start or resumption of a run.

        When: once per session, after everything is built and before the first rollout; after a resume
            too.

        Args:
            run: the run.
        """

    @hookspec(since=1)
    def run_finished(self, run: Run) -> None:
        """React to the end of a run.

        When: once, after the budget is used up, the last checkpoint is written and the final evaluation is
            done; not when a run is interrupted or fails.

        Args:
            run: the run.
        """

    @hookspec(since=1)
    def filter_observation(self, context: Context, side: int, obs: Tensor) -> Tensor | None:
        """Change a side's observation: noise, masking, defences.

        When: for each side, once per vectorised step before anyone acts, in training and in evaluation.
            Filters follow one another: required methods, the method, observers in the order of the
            configuration.

        Args:
            context: of the observation; ``context.side`` equals ``side``.
            side: 0 or 1.
            obs: that side's observation as the last filter left it, (n, o) or (n, o').

        Returns:
            the observation the next filter or that side gets, of the same shape, or ``None``: unchanged.
        """

    @hookspec(since=1)
    def extend_observation(self, context: Context, view: View) -> dict[str, Tensor] | None:
        """Add named groups to the adversary's observation.

        When: once per observation, in training and, without a run, wherever a trained adversary acts:
            evaluation, cross-play, video.

        Args:
            context: of the observation; ``context.mode`` is ``train`` or ``eval``.
            view: ``own`` (n, o), ``opponent`` (n, o'), ``first`` (n,) bool where a game has just begun,
                ``opponent_action`` (n, a').

        Returns:
            ``{name: (n, k) float32}``, always the same names and ``k``, or ``None``.
        """

    @hookspec(since=1)
    def shape_reward(self, run: Run, step: StepBatch) -> dict[str, Tensor] | None:
        """Add named terms to the adversary's reward r^α, each logged.

        When: once per vectorised step of the training games, not of those played by ``run.collect``.

        Args:
            run: the run.
            step: the ``StepBatch``: observations, actions, the victim's distribution, rewards of both sides,
                ``first``, ``done``, ``outcome``, ``cause``.

        Returns:
            ``{name: (n,) float32}`` in the units of ``step.reward``, or ``None``.
        """

    @hookspec(since=2)
    def relabel_reward(
        self, run: Run, rollout: Rollout, reward: Tensor, successors: Tensor, victim_successors: Tensor
    ) -> Tensor | None:
        """Replace the adversary's main reward over a whole rollout.

        When: once per rollout of the training games, before :meth:`finish_rollout`. Plugins follow one
            another: required methods, the method, observers in the order of the configuration.

        Args:
            run: the run.
            rollout: the ``Rollout``; its ``shaped_reward`` is not set yet.
            reward: the main reward as the last plugin left it, (T, n), in the units of ``rollout.reward``: at
                first the sum of that and all terms of :meth:`shape_reward`.
            successors: s^α after each step, terminal ones included, (T, n, o).
            victim_successors: the same of the victim, (T, n, o').

        Returns:
            the main reward the next plugin or the learner gets, (T, n) float32, not normalised, or ``None``:
            unchanged.
        """

    @hookspec(since=1)
    def finish_rollout(
        self, run: Run, rollout: Rollout, successors: Tensor, victim_successors: Tensor
    ) -> dict[str, Tensor] | None:
        """Add reward streams, each with its own critic.

        When: once per rollout, before advantages are computed.

        Args:
            run: the run.
            rollout: the ``Rollout``, all tensors (T, n, …).
            successors, victim_successors: see :meth:`relabel_reward`.

        Returns:
            ``{name: (T, n) float32}``, the same names in every rollout, or ``None``.
        """

    @hookspec(firstresult=True, since=1)
    def combine_advantages(self, run: Run, rollout: Rollout, streams: dict[str, Tensor]) -> Tensor | None:
        """Mix the streams' advantages into the one that PPO uses.

        When: once per rollout, after :meth:`finish_rollout`.

        Args:
            run: the run.
            rollout: the ``Rollout``.
            streams: ``{name: (T, n)}``: GAE of every stream, not normalised; ``"reward"`` is the main one.

        Returns:
            (T, n) float32, used as it is, or ``None``: the main stream's, normalised per minibatch.
        """

    @hookspec(since=1)
    def update_auxiliary(
        self, run: Run, rollout: Rollout, successors: Tensor, victim_successors: Tensor
    ) -> dict[str, float] | Callable[[], dict[str, float]] | None:
        """Train a method's auxiliary models.

        When: once per rollout, after advantages and before PPO; plugins one after the other, the required
            first. A returned function is called after all plugins' hooks, in parallel with PPO's update
            where there are two cores: it may use neither ``run.collect`` nor torch's global generator.

        Args:
            run: the run; ``run.collect`` and ``run.generator`` may be used here.
            rollout: the ``Rollout``; ``rollout.advantages`` is set.
            successors, victim_successors: see :meth:`relabel_reward`.

        Returns:
            ``{name: number}``, logged as ``<plugin>/<name>``; or a function of no arguments that does the
            work and returns that; or ``None``.
        """

    @hookspec(since=1)
    def iteration_finished(self, run: Run, metrics: dict[str, float]) -> None:
        """Read the metrics of an iteration.

        When: after every iteration, after the recorders received its metrics.

        Args:
            run: the run.
            metrics: ``{name: number}``, those the recorders received, but never merged.
        """

    @hookspec(since=1)
    def evaluation_finished(self, run: Run, result: dict[str, object]) -> None:
        """Read the score of an evaluation.

        When: after each evaluation during and at the end of a training; not after ``apil eval``.

        Args:
            run: the run.
            result: the score as plain data, as ``apil eval --json`` prints it.
        """
