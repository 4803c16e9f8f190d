"""Methods that each fail one check; ``CHECKS`` says which, where it is documented, and what is said."""

from __future__ import annotations

import random
from typing import Any, ClassVar

import numpy as np
import torch
from pydantic import BaseModel, Field

from apil_core import Method, MethodSpec, Section, hookimpl, hookspec


def method(name: str, **more: Any) -> MethodSpec:
    return MethodSpec("bad", f"{__name__}:{name}", **more)


def filled(**hooks: Any) -> type[Method]:
    """A method with these functions as hooks."""
    return type("Bad", (Method,), {name: hookimpl(function) for name, function in hooks.items()})


# --- options


class Open(BaseModel):
    """Takes anything."""

    weight: float = 1.0
    """Documented."""


class Silent(Section):
    """An option without a docstring."""

    weight: float = 1.0


class Demanding(Section):
    """Not valid by itself."""

    weight: float
    """Must be given."""


class Outer(Section):
    """The mistake is further in."""

    inner: Silent = Silent()


class Lossy(Section):
    """Does not come back from JSON."""

    weight: float = Field(1.0, exclude=True)
    """Left out."""
    bias: float = Field(default_factory=lambda: random.SystemRandom().random(), exclude=True)
    """Another one each time."""


OPTIONS = [
    ("Open", "takes unknown keys; derive it from apil_core.Section"),
    ("Silent", "broken_methods:Silent.weight has no docstring below it"),
    ("Outer", "broken_methods:Outer.inner.weight has no docstring below it"),
    ("Demanding", "is not valid without arguments: weight: Field required"),
    ("Lossy", "is another one after a round trip through JSON"),
    ("method", "must be a pydantic model"),
]

# --- the class itself


class Unmarked(Method):
    def shape_reward(self, run, step):
        return {"bonus": step.reward}


class RegistersInClass(Method):
    @hookimpl
    def register_methods(self):
        return []


class ForgetsToReturn(Method):
    @hookimpl
    def shape_reward(self, run, step):
        {"bonus": step.reward}


class WrapsWithoutReturn(Method):
    @hookimpl(wrapper=True)
    def shape_reward(self, run, step):
        terms = yield
        terms.append({"bonus": step.reward})


@hookspec
def bad_hook(run):
    """Opened by nobody who calls it."""


class FillsWhatNobodyCalls(Method):
    @hookimpl
    def bad_hook(self, run):
        return None


# --- state


class CannotLoad(Method):
    def state_dict(self):
        return {"weight": torch.ones(1)}


class KeepsArrays(Method):
    def state_dict(self):
        return {"inner": {"weight": np.ones(1)}}


class LoadsNothing(Method):
    def __init__(self, options, setup):
        super().__init__(options, setup)
        self.weight = torch.randn(3)

    def state_dict(self):
        return {"weight": self.weight}

    def load_state_dict(self, state):
        pass


# --- what it is handed, and what it draws


def _double(tensor):
    tensor.mul_(2)


ChangesStep = filled(shape_reward=lambda self, run, step: _double(step.victim_reward))
ChangesView = filled(extend_observation=lambda self, context, view: _double(view.own))
ChangesMetrics = filled(iteration_finished=lambda self, run, metrics: metrics.update(mine=1.0))
ChangesStreams = filled(combine_advantages=lambda self, run, rollout, streams: streams.pop("reward"))
DrawsGlobally = filled(shape_reward=lambda self, step: {"bonus": torch.rand(len(step.reward))})
DrawsFromNumpy = filled(update_auxiliary=lambda self: {"draw": np.random.rand()})
DrawsFromRandom = filled(update_auxiliary=lambda self: {"draw": random.random()})

# --- answers

WrongShape = filled(shape_reward=lambda self, step: {"bonus": step.reward[:3]})
NotFinite = filled(extend_observation=lambda self, view: {"g": view.own * float("nan")})
Crashes = filled(update_auxiliary=lambda self, rollout: {"x": rollout.no_such_thing})

# --- seeds, resuming


class RemembersRuns(Method):
    runs: ClassVar[int] = 0

    def __init__(self, options, setup):
        super().__init__(options, setup)
        RemembersRuns.runs += 1
        self.bonus = float(RemembersRuns.runs)

    @hookimpl
    def shape_reward(self, step):
        return {"bonus": self.bonus * step.observation[:, 0]}


class SeedsTorch(Method):
    def __init__(self, options, setup):
        super().__init__(options, setup)
        torch.manual_seed(0)


class ForgetsItsCount(Method):
    def __init__(self, options, setup):
        super().__init__(options, setup)
        self.count = 0

    @hookimpl
    def shape_reward(self, step):
        self.count += 1
        return {"bonus": self.count * step.observation[:, 0]}


class ForgetsForTheLog(ForgetsItsCount):
    @hookimpl
    def shape_reward(self, step):
        self.count += 1
        return None

    @hookimpl
    def update_auxiliary(self):
        return {"count": self.count}


# --- without a run


class NeedsItsRun(Method):
    run = None

    @hookimpl
    def run_started(self, run):
        self.run = run

    @hookimpl
    def extend_observation(self, context, view):
        steps = self.run.steps if context.mode == "eval" else 0
        return {"clock": torch.full((len(view.own), 1), float(steps))}


CountsGames = filled(extend_observation=lambda self, view: {"share": torch.full((len(view.own), 1), 0.5)})


class KnowsItsNumber(Method):
    built: ClassVar[int] = 0

    def __init__(self, options, setup):
        super().__init__(options, setup)
        type(self).built += 1
        self.number = self.built

    @hookimpl
    def extend_observation(self, view):
        return {"numbered": view.own * self.number}


class CarriesOver(Method):
    """Its last observation of one game opens the next."""

    def __init__(self, options, setup):
        super().__init__(options, setup)
        self.last = torch.zeros(0, setup.adversary.observation_size)

    @hookimpl
    def extend_observation(self, view):
        last = self.last if len(self.last) == len(view.own) else torch.zeros_like(view.own)
        self.last = view.own.clone()
        return {"last": last}

    def state_dict(self):
        return {"last": self.last}

    def load_state_dict(self, state):
        self.last = state["last"]


def _refuses_the_blind(context, view):
    if context.mode == "eval" and len(view.own) > 1 and bool((view.opponent == view.opponent[0]).all()):
        raise ValueError("all opponents are alike")


RefusesTheBlind = filled(extend_observation=lambda self, context, view: _refuses_the_blind(context, view))

# --- sizes and company

NormalisesOverGames = filled(shape_reward=lambda self, step: {"z": step.reward - step.reward.std()})


def _small_buffer(self, step):
    torch.zeros(32)[: len(step.reward)] += step.reward


CountsOn32Games = filled(shape_reward=lambda self, step: _small_buffer(self, step))


class DropsOthers(Method):
    @hookimpl(wrapper=True)
    def shape_reward(self, step):
        yield
        return [{"mine": step.reward}]


def _only_stream(self, streams):
    (reward,) = streams.values()
    return reward


CountsOnOneStream = filled(combine_advantages=_only_stream)

# name, documented in, what is said
WITHOUT_A_RUN = [
    ("Unmarked", "hooks.md#shape_reward", "Unmarked.shape_reward is named like a hook but not marked"),
    ("RegistersInClass", "hooks.md#register_methods", "register_methods is a hook of the plugin's module"),
    ("ForgetsToReturn", "hooks.md#shape_reward", "shape_reward has no "),
    ("WrapsWithoutReturn", "hooks.md#shape_reward", "shape_reward is a wrapper without `return`"),
    ("CannotLoad", "testing.md#state", "CannotLoad has no state to load, got ['weight']"),
    ("KeepsArrays", "testing.md#state", "as built: state_dict()['inner']['weight'] is a numpy array"),
    (
        "LoadsNothing",
        "testing.md#state",
        "a fresh object that loaded the state of as built has another: weight",
    ),
]

# name, check, hook it is called by, what is said
IN_ONE_CALL = [
    ("ChangesView", "unchanged", "extend_observation", "changed view.own"),
    ("ChangesMetrics", "unchanged", "iteration_finished", "changed metrics"),
    ("ChangesStreams", "unchanged", "combine_advantages", "changed streams[reward]"),
    ("DrawsGlobally", "randomness", "shape_reward", "drew from, or seeded, torch's global generator"),
    ("DrawsFromNumpy", "randomness", "update_auxiliary", "drew from, or seeded, numpy's global generator"),
    ("DrawsFromRandom", "randomness", "update_auxiliary", "drew from, or seeded, Python's module random"),
]

WATCHED = [
    ("ChangesStep", "hooks.md#shape_reward", "shape_reward (filled by bad) changed step.victim_reward"),
    ("WrongShape", "hooks.md#shape_reward", "'bonus' must be (6,) float32, got (3,)"),
    ("NotFinite", "hooks.md#extend_observation", "'g' must be finite, got NaN or infinite values"),
    ("Crashes", "hooks.md#update_auxiliary", "plugin 'bad' failed in update_auxiliary: AttributeError"),
    (
        "NeedsItsRun",
        "hooks.md#extend_observation",
        "AttributeError: 'NoneType' object has no attribute 'steps'",
    ),
]
