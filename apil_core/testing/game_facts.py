"""Checks of a game that need one play: its layout, its arrays, its endings."""

from __future__ import annotations

from collections import Counter

import numpy as np

from apil_core.api.game import NO_WINNER, Array, Game, GameStep, SideLayout
from apil_core.testing.checks import checking
from apil_core.testing.game_play import GAMES, Play, Trial, parts

LONGEST = 1000
"""Steps after which a check stops waiting for a game to end."""


@checking("layout")
def layout(trial: Trial) -> None:
    """Check sizes, blocks, channels, bounds and causes."""
    with trial.game(2) as game:
        found = game.layout
        different = len(found.sides) == 2 and found.sides[0].name != found.sides[1].name
        trial.need(different, "there must be two sides with different names")
        for side in found.sides:
            reason = _misfit(side)
            trial.need(reason is None, f"side {side.name}: {reason}")
        unique = len(set(found.causes)) == len(found.causes) > 0
        trial.need(unique, f"causes must be names, each once, got {found.causes}")
        positive = found.max_steps >= 1 and game.num_envs == 2 and game.seconds_per_step > 0
        trial.need(positive, "max_steps, num_envs or seconds_per_step is not as it must be")


def _misfit(side: SideLayout) -> str | None:
    """Describe what is wrong with a side, or return ``None``."""
    if not side.action_low < side.action_high:
        return f"action bounds {side.action_low}, {side.action_high}"
    if side.observation_size < 1 or side.action_size < 1:
        return f"sizes {side.observation_size}, {side.action_size}"
    end = 0
    for name, block in side.blocks.items():
        if block.start != end or block.stop <= block.start or block.step not in (None, 1):
            return f"block {name} is {block.start}:{block.stop}, but the one before it ends at {end}"
        end = block.stop
    if side.blocks and end != side.observation_size:
        return f"blocks end at {end} of {side.observation_size}"
    channels = side.opponent_channels
    wrong = [channel for channel in channels if not 0 <= channel < side.observation_size]
    if wrong or len(set(channels)) != len(channels):
        return f"opponent_channels must be columns of the observation, each once, got {wrong or channels}"
    return None


@checking("arrays")
def arrays(trial: Trial) -> None:
    """Check shapes, types and finiteness of all arrays of a step."""
    with trial.game() as game:
        _look_at_observations(trial, game, "after reset")
        play = Play(game)
        for _ in range(5):
            _look_at_step(trial, play.run(1))
            _look_at_observations(trial, game, "after a step")


def _look_at_observations(trial: Trial, game: Game, when: str) -> None:
    for side, seen in zip(game.layout.sides, game.observations, strict=True):
        what, want = f"{side.name}'s observations {when}", (game.num_envs, side.observation_size)
        fits = seen.shape == want and seen.dtype == np.float32
        trial.need(fits, f"{what} must be {want} float32, got {seen.shape} {seen.dtype}")
        trial.need(np.isfinite(seen).all(), f"{what} have NaN or infinite values")


def _look_at_step(trial: Trial, step: GameStep) -> None:
    types = {"done": bool, "winner": np.int8, "cause": np.int8, "lengths": np.int32}
    for name, value in {**parts(step), "lengths": step.lengths}.items():
        want, kind = (GAMES,) if name in types else (2, GAMES), np.dtype(types.get(name, np.float32))
        made = isinstance(value, np.ndarray)
        got = f"{value.shape} {value.dtype}" if made else type(value).__name__
        fits = made and value.shape == want and value.dtype == kind
        trial.need(fits, f"GameStep.{name} must be {want} {kind}, got {got}")
        trial.need(np.isfinite(value).all(), f"GameStep.{name} has NaN or infinite values")


@checking("endings")
def endings(trial: Trial) -> None:
    """Check the outcomes of ended games, and of running ones."""
    ended: Counter[str] = Counter()
    with trial.game() as game:
        play = Play(game)
        clock = np.zeros(GAMES, np.int64)
        for _ in range(min(game.layout.max_steps, LONGEST) + 5):
            step = play.run(1)
            clock += 1
            _check_outcome(trial, step, game, clock)
            ended.update(game.layout.causes[cause] for cause in step.cause[step.done])
            clock[step.done] = 0
    if not ended:
        trial.skipped.append(f"endings: no game ended within {LONGEST} steps of random play")
    trial.endings = dict(ended)


def _check_outcome(trial: Trial, step: GameStep, game: Game, clock: Array) -> None:
    done, going, causes = step.done, ~step.done, len(game.layout.causes)
    winners = sorted(set(step.winner.tolist()))
    trial.need({*winners} <= {0, 1, NO_WINNER}, f"winner must be 0, 1 or {NO_WINNER}, got {winners}")
    trial.need((step.winner[going] == NO_WINNER).all(), "a game that goes on has a winner")
    known = ((step.cause[done] >= 0) & (step.cause[done] < causes)).all()
    trial.need(known, f"cause must index the {causes} causes where a game ended")
    trial.need((step.sparse[:, going] == 0).all(), "sparse must be zero while a game goes on")
    counted = f"lengths must count the steps of each game, this one included: {step.lengths} for {clock}"
    trial.need((step.lengths == clock).all(), counted)
    limit = game.layout.max_steps
    trial.need((clock[going] < limit).all(), f"a game went on after max_steps ({limit})")
