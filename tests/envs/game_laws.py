"""What must hold after every step of every game, whatever was played: see :func:`check`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apil_core import NO_WINNER, Game, GameStep

WIN, LOSE = 1000, -1000
TIE = NO_WINNER
Outcome = tuple[int, set[tuple[float, float]]]
"""Winner, and the pairs of sparse rewards that may go with it."""

NOTHING: Outcome = (TIE, {(0, 0)})
KEEPER_WINS: Outcome = (1, {(LOSE, 1000), (LOSE, 1500), (LOSE, 2000)})
BOTH_LOSE: Outcome = (TIE, {(LOSE, LOSE)})

_SUMO: dict[str, Outcome] = {
    "both-fell": BOTH_LOSE,
    "both-left-ring": BOTH_LOSE,
    "time-up": BOTH_LOSE,
    "diverged": NOTHING,
}
for _how in ("fell", "left-ring"):
    _SUMO |= {
        f"fighter_0-{_how}": (1, {(LOSE, WIN)}),
        f"fighter_1-{_how}": (0, {(WIN, LOSE)}),
        f"fighter_0-{_how}-untouched": (TIE, {(LOSE, 0)}),
        f"fighter_1-{_how}-untouched": (TIE, {(0, LOSE)}),
    }
_RUN_TO_GOAL: dict[str, Outcome] = {
    "runner_0-arrived": (0, {(WIN, LOSE)}),
    "runner_1-arrived": (1, {(LOSE, WIN)}),
    **dict.fromkeys(("both-arrived", "both-down", "time-up", "diverged"), NOTHING),
}
OUTCOMES: dict[str, dict[str, Outcome]] = {
    "kick-and-defend": {
        "goal": (0, {(WIN, LOSE)}),
        **dict.fromkeys(("ball-outside", "ball-turned-back", "both-down", "time-up"), KEEPER_WINS),
        "keeper-left-goal": (TIE, {(0, LOSE)}),
        "diverged": NOTHING,
    },
    "you-shall-not-pass": {
        "passed": (1, {(LOSE, WIN)}),
        "runner-down": (0, {(WIN, LOSE), (0, LOSE)}),
        "time-up": (0, {(0, LOSE)}),
        "diverged": NOTHING,
    },
    "sumo-humans": _SUMO,
    "sumo-ants": _SUMO,
    "run-to-goal-humans": _RUN_TO_GOAL,
    "run-to-goal-ants": _RUN_TO_GOAL,
    "toy-pursuit": {
        "caught": (1, {(LOSE, 1000), (LOSE, 1500)}),
        "escaped": (0, {(WIN, LOSE)}),
        "time-up": (TIE, {(LOSE, LOSE)}),
    },
}


@dataclass
class Before:
    """What a step started from.

    Attributes:
        playing: games that are not over and are asked to go on, (n,) bool.
        lengths: steps played, (n,).
        observations: of both sides.
    """

    playing: np.ndarray
    lengths: np.ndarray
    observations: tuple[np.ndarray, np.ndarray]


def check(name: str, game: Game, before: Before, step: GameStep) -> None:
    """Assert everything the contract and the rules of ``name`` promise of one step."""
    playing, done = before.playing, step.done
    assert not (done & ~playing).any(), "a game ended that was over or not played"
    assert ((step.winner == NO_WINNER) | done & np.isin(step.winner, (0, 1))).all()
    assert ((step.cause >= 0) == done).all()
    np.testing.assert_array_equal(step.lengths, before.lengths + playing)
    over_time = step.lengths >= game.layout.max_steps
    assert done[over_time & playing].all(), "a game went on after its time"
    for reward in (step.sparse, step.dense, step.shaping):
        assert np.isfinite(reward).all()
        assert (reward[:, ~playing] == 0).all()
    assert (step.sparse[:, ~done] == 0).all()
    for cause, (winner, rewards) in OUTCOMES[name].items():
        rows = done & (step.cause == game.layout.causes.index(cause))
        assert (step.winner[rows] == winner).all(), cause
        seen = set(map(tuple, step.sparse[:, rows].T.tolist()))
        assert seen <= rewards, (cause, seen)
        if cause == "time-up":
            assert over_time[rows].all()
        if cause == "diverged":
            assert (step.dense[:, rows] == 0).all()
    for side, now, old in zip(game.layout.sides, game.observations, before.observations, strict=True):
        assert now.shape == (game.num_envs, side.observation_size)
        assert now.dtype == np.float32
        assert np.isfinite(now).all()
        np.testing.assert_array_equal(now[~playing], old[~playing])
