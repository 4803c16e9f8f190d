"""The conformance check finds what breaks a policy's promises, and leaves the policy as it was."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from apil_core import Decision, DiagonalGaussian, Policy, PolicyInfo, VictimError, View, load_policy
from apil_core.policies.conformance import check_policy, examine
from policies.foreign_files import seat, view


class Made(Policy):
    """Acts as told."""

    def __init__(self, act: Any, bounds: tuple[float, float] | None = None):
        self.info = PolicyInfo("made:up", "0" * 64, 7, 2, action_bounds=bounds)
        self._act = act

    def act(self, view: View, *, sample: bool, generator: Any = None, activations: bool = False) -> Decision:
        decision: Decision = self._act(view)
        return decision


def gaussian(mean: torch.Tensor, std: torch.Tensor) -> Decision:
    return Decision(torch.zeros(len(mean), 2), DiagonalGaussian(mean, std))


BROKEN = {
    "action must have shape (4, 2), got (2, 4)": lambda v: Decision(torch.zeros(2, len(v.own))),
    "action must be float32, got float64": lambda v: Decision(v.own[:, :2].double()),
    "action must be a tensor, got ndarray": lambda v: Decision(v.own[:, :2].numpy()),
    "action has NaN or infinite values": lambda v: Decision(v.own[:, :2] / 0),
    "distribution.mean must have shape (4, 2), got (4, 3)": lambda v: gaussian(v.own[:, :3], torch.ones(2)),
    "distribution.std must have shape (4, 2), got (1,)": lambda v: gaussian(v.own[:, :2], torch.ones(1)),
    "distribution.std must be positive": lambda v: gaussian(v.own[:, :2], torch.zeros(2)),
    "fails on 4 games: RuntimeError: The size of tensor": lambda v: Decision(
        v.own[:, :2] + torch.zeros(3, 2)
    ),
    "fails on 1 games: IndexError": lambda v: Decision(v.own[:, :2] + 0 * v.own[3, 0]),
}


@pytest.mark.parametrize("message", BROKEN)
def test_what_is_wrong_is_named(message: str) -> None:
    with pytest.raises(VictimError, match="^made:up: ") as caught:
        check_policy(Made(BROKEN[message]), seat())
    assert message in str(caught.value)


class Forgetful(Policy):
    """Sums up what it sees; ``clears`` says whether a new game starts from nought."""

    def __init__(self, clears: bool):
        self.info = PolicyInfo("made:sum", "0" * 64, 7, 2)
        self.clears = clears
        self.sum = torch.zeros(0, 2)

    def act(self, view: View, *, sample: bool, generator: Any = None, activations: bool = False) -> Decision:
        if len(self.sum) != len(view.own):
            self.sum = torch.zeros(len(view.own), 2)
        if self.clears:
            self.sum = torch.where(view.first.unsqueeze(1), 0.0, self.sum)
        self.sum = self.sum + view.own[:, :2]
        return Decision(self.sum)

    def recurrent_state(self) -> dict[str, Any]:
        return {"sum": self.sum}

    def load_recurrent_state(self, state: dict[str, Any]) -> None:
        self.sum = state["sum"]


def test_a_state_that_outlives_its_game_is_found() -> None:
    assert check_policy(Forgetful(clears=True), seat()).recurrent
    with pytest.raises(VictimError, match="a new game depends on the game before it: clear the rows"):
        check_policy(Forgetful(clears=False), seat())


def test_the_policy_is_left_as_it_was() -> None:
    policy = Forgetful(clears=True)
    policy.act(view(3), sample=False)
    before = policy.sum.clone()
    examine(policy, seat())
    assert torch.equal(policy.sum, before)
    state = torch.random.get_rng_state()
    examine(load_policy("scripted:toy-pursuit/evader/v1"), seat())
    assert torch.equal(torch.random.get_rng_state(), state)


def test_declared_bounds_must_be_the_seats_and_others_are_a_note() -> None:
    wide = Made(lambda v: Decision(5 * v.own[:, :2]))
    found = examine(wide, seat())
    assert (found.errors, len(found.notes)) == ([], 1)
    assert "the game clips them to [-1, 1]" in found.notes[0]
    assert examine(Made(lambda v: Decision(v.own[:, :2]), bounds=(-1, 1)), seat()).errors == []
    assert examine(Made(lambda v: Decision(v.own[:, :2]), bounds=(-2, 2)), seat()).errors == [
        "made for actions in [-2, 2], but the evader's are in [-1, 1]"
    ]


def test_a_random_mode_is_noted() -> None:
    found = examine(Made(lambda v: Decision(torch.rand(len(v.own), 2))), seat())
    assert found.random_mode
    assert found.errors == []
    assert "its mode is random too" in found.notes[0]


@pytest.mark.parametrize(
    "name", ["baseline:random/7x2", "baseline:zero/7x2", "scripted:toy-pursuit/evader/v1"]
)
def test_our_own_policies_conform(name: str) -> None:
    found = check_policy(load_policy(name), seat())
    assert not found.recurrent
