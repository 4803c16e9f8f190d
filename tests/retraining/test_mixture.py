"""A seat shared by several policies."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from apil_core import Decision, Policy, load_policy
from apil_core.api.policy import PolicyInfo
from apil_core.api.types import View
from apil_core.runs.retraining.mixture import MixturePolicy
from retraining.victims import student, views


class Constant(Policy):
    """Always the same action; counts how often it is asked."""

    def __init__(self, value: float):
        self.info = PolicyInfo(f"constant:{value}", str(value), 3, 1)
        self.value = value
        self.asked = 0

    def act(self, view, *, sample, generator=None, activations=False):
        self.asked += 1
        return Decision(view.own.new_full((len(view.own), 1), self.value))


def actions(mixture: MixturePolicy, first: torch.Tensor) -> torch.Tensor:
    """(T, n) for flags (T, n)."""
    own = torch.zeros(first.shape[1], 3)
    return torch.stack([mixture.act(View(own, own, row), sample=True).action[:, 0] for row in first])


def flags(steps: int, games: int, every: int) -> torch.Tensor:
    return ((torch.arange(steps) % every) == 0).unsqueeze(1).expand(steps, games)


def test_a_game_is_played_by_one_policy_and_games_in_their_shares() -> None:
    mixture = MixturePolicy([Constant(0.0), Constant(1.0), Constant(2.0)], [0.2, 0.3, 0.5], "per_episode")
    games = actions(mixture, flags(40, 500, 10)).view(4, 10, 500)
    assert (games == games[:, :1]).all()
    shares = [float((games == k).float().mean()) for k in range(3)]
    # 2000 games: four standard errors of a share are at most 0.045
    assert shares == pytest.approx([0.2, 0.3, 0.5], abs=0.045)
    assert torch.equal(mixture.turn, games[-1, -1].long())


def test_only_new_games_change_hands() -> None:
    mixture = MixturePolicy([Constant(0.0), Constant(1.0)], [1, 1], "per_episode")
    first = torch.zeros(2, 400, dtype=torch.bool)
    first[0], first[1, :200] = True, True
    before, after = actions(mixture, first)
    assert torch.equal(before[200:], after[200:])
    assert not torch.equal(before[:200], after[:200])


def test_turns_may_change_with_every_step() -> None:
    mixture = MixturePolicy([Constant(0.0), Constant(1.0)], [0.25, 0.75], "per_step")
    played = actions(mixture, flags(50, 100, 50))
    assert float(played.mean()) == pytest.approx(0.75, abs=0.03)
    assert float((played[1:] != played[:-1]).float().mean()) == pytest.approx(2 * 0.25 * 0.75, abs=0.03)


def test_a_policy_without_a_share_is_not_asked() -> None:
    idle = Constant(5.0)
    assert not (
        actions(MixturePolicy([idle, Constant(1.0)], [0, 1], "per_episode"), flags(9, 50, 3)) == 5
    ).any()
    assert idle.asked == 0
    with pytest.raises(ValueError, match="need as many shares"):
        MixturePolicy([idle], [0], "per_episode")


@pytest.mark.parametrize("mix", ["per_episode", "per_step"])
def test_each_policy_has_followed_every_game(tmp_path: Path, mix: str) -> None:
    """Where it is its turn, a recurrent policy does what it would have done had it watched alone."""
    names = [student(tmp_path / f"{i}.safetensors", seed=i) for i in range(2)]
    mixture = MixturePolicy([load_policy(name) for name in names], [1, 1], mix)
    alone = [load_policy(name) for name in names]
    for view in views(15, 6, 7):
        expected = [policy.act(view, sample=False).action for policy in alone]
        decision = mixture.act(view, sample=False)
        for game, turn in enumerate(mixture.turn.tolist()):
            assert torch.equal(decision.action[game], expected[turn][game])
        assert decision.distribution is not None
        assert torch.equal(decision.distribution.mean, decision.action)


def test_it_goes_on_from_its_state(tmp_path: Path) -> None:
    name = student(tmp_path / "s.safetensors")
    whole, part = (
        MixturePolicy([load_policy(name), load_policy("baseline:zero/7x2")], [1, 1], "per_episode", seed=4)
        for _ in range(2)
    )
    steps = views(12, 6, 7)
    played = [whole.act(view, sample=False).action for view in steps[:6]]
    part.load_recurrent_state(whole.recurrent_state())
    for view in steps[6:]:
        played = whole.act(view, sample=False).action
        assert torch.equal(played, part.act(view, sample=False).action)
    whole.load_recurrent_state({})
    assert len(whole.turn) == 0
