"""Base classes of methods and observers, and the interface of the run that hooks get."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import torch

from apil_core.api.hooks import PROJECT, hookimpl
from apil_core.api.hookspecs import RunHooks

if TYPE_CHECKING:
    from pydantic import BaseModel

    from apil_core.api.config import PPOConfig, RunConfig
    from apil_core.api.game import GameLayout, SideLayout
    from apil_core.api.policy import Policy, PolicyInfo
    from apil_core.api.types import Decision, Rollout


@dataclass(frozen=True)
class MethodSetup:
    """Arguments a method or an observer is built from, the same in training and in a later evaluation.

    Attributes:
        layout: sizes of both sides.
        adversary_side: index of the trained side; the victim has the other.
        device: where networks live.
        seed: for the initial weights; torch's global generator is seeded before construction.
        ppo: settings shared by all methods.
        methods: the methods this one requires, already built, by name; for an observer the run's, or none
            where a policy is scored that no method trained.
    """

    layout: GameLayout
    adversary_side: int
    device: torch.device
    seed: int
    ppo: PPOConfig
    methods: Mapping[str, Method]

    @property
    def adversary(self) -> SideLayout:
        """Layout of the trained side."""
        return self.layout.sides[self.adversary_side]

    @property
    def victim(self) -> SideLayout:
        """Layout of the attacked side."""
        return self.layout.sides[1 - self.adversary_side]


class RunPlugin:
    """Base of methods and observers: options, and a state that survives a restart.

    Hooks are methods marked with ``@hookimpl``. Subclasses build their networks in ``__init__`` and
    return everything that must survive a restart (weights, optimisers, statistics) from :meth:`state_dict`.
    """

    def __init__(self, options: BaseModel | None, setup: MethodSetup):
        self.options = options
        self.setup = setup

    def state_dict(self) -> dict[str, Any]:
        """Tensors, numbers, strings and dicts of them; empty for one without state."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        if state:
            raise ValueError(f"{type(self).__name__} has no state to load, got {sorted(state)}")

    def acting_state_dict(self) -> dict[str, Any]:
        """The state that acting needs, without optimisers and the like: what ``apil export`` writes to a
        safetensors file. :meth:`load_state_dict` reads it, too. Default: all of :meth:`state_dict`."""
        return self.state_dict()


class Method(RunPlugin):
    """Base of every attack method.

    The same object without a run is used in evaluation, so ``extend_observation`` may use only what
    is built in ``__init__``.
    """


class Observer(RunPlugin):
    """Base of observers with options or a state: run hooks that are switched on beside any method.

    One that fills ``filter_observation`` also acts where a policy is scored without its run.
    """


class Callback(Observer):
    """An observer that is made by hand for one run: ``run(config, callbacks=[MyCallback()])``.

    Override any of the hooks of a run (docs/hooks.md), without ``@hookimpl``, with only the arguments it
    needs; ``run.stop()`` ends training. A callback that takes part (observations, rewards, advantages,
    auxiliary models) is stored with the run under its class's name, and without it the run is neither
    resumed nor evaluated; one that only watches is not.
    """

    def __init_subclass__(cls, **kwargs: Any):
        super().__init_subclass__(**kwargs)
        for name in vars(RunHooks).keys() & vars(cls).keys():
            if inspect.isfunction(function := vars(cls)[name]) and not hasattr(function, f"{PROJECT}_impl"):
                hookimpl(function)

    def __init__(self) -> None:
        """Take neither options nor a setup: those are a run's."""


class WhiteBox(Protocol):
    """The victim as white-box methods see it.

    Attributes:
        info: its identity.
    """

    info: PolicyInfo

    def replay(self, rollout: Rollout, observation: torch.Tensor | None = None) -> Decision:
        """Let the victim decide again at every step of a rollout, with gradients.

        Its recurrent state goes through the rollout from where it began, reset where games start. Nothing
        is drawn: ``action`` is the mean. Not for rollouts of ``run.collect``.

        Args:
            rollout: the present one of the training games, whole.
            observation: seen instead of ``rollout.victim_observation``, (T, n, o'); gradients reach it, also
                from later steps of the same game if the victim is recurrent.

        Returns:
            ``distribution`` and the layers in ``activations``, (T, n, …) each.
        """
        ...


class Run(Protocol):
    """The run's interface for hooks.

    Attributes:
        config: the resolved configuration.
        layout: of the game.
        adversary_side: index of the trained side.
        device: of the networks.
        generator: for a method's own random draws; saved and restored with the run.
        steps: environment steps collected so far (all rollouts, :meth:`collect` included).
        total_steps: the run's budget.
        iteration: index of the current iteration, from 0.
        hook: caller of all hooks, those defined by methods included: ``run.hook.<name>(...)``.
    """

    config: RunConfig
    layout: GameLayout
    adversary_side: int
    device: torch.device
    generator: torch.Generator
    total_steps: int
    iteration: int
    hook: Any

    @property
    def steps(self) -> int:
        """Environment steps collected so far."""
        ...

    @property
    def victim(self) -> WhiteBox:
        """The victim's inside, for methods with ``white_box`` in their spec; else a ``PluginError``."""
        ...

    def stop(self, reason: str = "asked by a hook") -> None:
        """End training after this iteration, as if the budget were used up; the ``reason`` is stored."""
        ...

    def collect(self, victim_side_policy: Policy, steps: int) -> Rollout:
        """Play ``steps`` vectorised steps in a second set of games, the current adversary against the
        given policy in the victim's seat. Counted in the budget; not used by PPO."""
        ...
