"""The perturbed opponent: which games, how far, and new for each game."""

from __future__ import annotations

import torch

from apil_core import Decision, Policy, PolicyInfo, View
from apil_core.runs.distillation.collector import Roles
from apil_core.runs.distillation.opponents import PerturbedOpponent


class Ones(Policy):
    info = PolicyInfo("ones", "", 1, 2)

    def act(self, view: View, *, sample: bool, generator=None, activations: bool = False) -> Decision:
        return Decision(torch.ones(len(view.own), 2))


def play(games: int, perturbed: torch.Tensor, steps: int = 200) -> torch.Tensor:
    opponent = PerturbedOpponent(Ones(), perturbed, torch.Generator().manual_seed(0))
    own, first = torch.zeros(games, 1), torch.ones(games, dtype=torch.bool)
    actions = [opponent.act(View(own, own, first))]
    actions += [opponent.act(View(own, own, ~first)) for _ in range(steps - 1)]
    return torch.stack(actions)  # (steps, games, 2)


def test_games_outside_the_mask_are_played_as_given() -> None:
    actions = play(4, torch.tensor([True, False, True, False]))
    assert torch.equal(actions[:, 1::2], torch.ones(200, 2, 2))
    assert actions[:, ::2].std() > 0.1


def test_half_the_perturbed_games_keep_the_action_a_quarter_drop_it() -> None:
    actions = play(2000, torch.ones(2000, dtype=torch.bool))
    kept = actions.mean((0, 2))
    spread = actions.std(0).mean(1)
    assert 0 <= spread.min() < 0.01
    assert 1.4 < spread.max() < 1.7
    # of the mean of 400 draws of std ≤ 1.5, 4 standard errors are 0.3
    dropped, whole = (kept.abs() < 0.3).float().mean(), ((kept - 1).abs() < 0.3).float().mean()
    assert 0.2 < dropped < 0.25 + 0.25 * 0.3 + 0.05
    assert 0.45 < whole < 0.5 + 0.25 * 0.3 + 0.05


def test_the_roles_cover_teacher_student_draws_and_modes_with_both_opponents() -> None:
    roles = Roles.of(128, torch.device("cpu"), teacher_only=False)
    kinds = set(
        zip(roles.teacher_acts.tolist(), roles.sampled.tolist(), roles.perturbed.tolist(), strict=True)
    )
    assert len(kinds) == 8
    assert (roles.teacher_acts.sum(), roles.sampled.sum(), roles.perturbed.sum()) == (32, 96, 64)
    assert Roles.of(8, torch.device("cpu"), teacher_only=True).teacher_acts.all()
