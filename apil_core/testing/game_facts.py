"""Checks of a game that need one play: its layout, its arrays, its endings."""

from __future__ import annotations

import numpy as np

from apil_core.api.game import NO_WINNER, Array, Game, GameStep, SideLayout
from apil_core.testing.game_play import GAMES, Play, Trial, parts

LONGEST = 1000
"""Steps after which a check stops waiting for a game to end."""


def layout(trial: Trial) -> None:
    """Check sizes, blocks, channels, bounds and causes."""
    with trial.game(2) as game:
        found = game.layout
        if len(found.sides) != 2 or found.sides[0].name == found.sides[1].name:
            raise trial.broken("layout", "there must be two sides with different names")
        for side in found.sides:
            if (reason := _misfit(side)) is not None:
                raise trial.broken("layout", f"side {side.name}: {reason}")
        if len(set(found.causes)) != len(found.causes) or not found.causes:
            raise trial.broken("layout", f"causes must be names, each once, got {found.causes}")
        if found.max_steps < 1 or game.num_envs != 2 or game.seconds_per_step <= 0:
            raise trial.broken("layout", "max_steps, num_envs or seconds_per_step is not as it must be")


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
        want = (game.num_envs, side.observation_size)
        if seen.shape != want or seen.dtype != np.float32:
            text = f"{side.name}'s observations {when} must be {want} float32, got {seen.shape} {seen.dtype}"
            raise trial.broken("arrays", text)
        if not np.isfinite(seen).all():
            raise trial.broken("arrays", f"{side.name}'s observations {when} have NaN or infinite values")


def _look_at_step(trial: Trial, step: GameStep) -> None:
    types = {"done": bool, "winner": np.int8, "cause": np.int8, "lengths": np.int32}
    for name, value in {**parts(step), "lengths": step.lengths}.items():
        kind = np.dtype(types.get(name, np.float32))
        want = (GAMES,) if name in types else (2, GAMES)
        if not isinstance(value, np.ndarray) or value.shape != want or value.dtype != kind:
            got = f"{value.shape} {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
            raise trial.broken("arrays", f"GameStep.{name} must be {want} {kind}, got {got}")
        if not np.isfinite(value).all():
            raise trial.broken("arrays", f"GameStep.{name} has NaN or infinite values")


def endings(trial: Trial) -> None:
    """Check the outcomes of ended games, and of running ones."""
    ended: dict[str, int] = {}
    with trial.game() as game:
        play = Play(game)
        clock = np.zeros(GAMES, np.int64)
        for _ in range(min(game.layout.max_steps, LONGEST) + 5):
            step = play.run(1)
            clock += 1
            if (reason := _contradiction(step, game, clock)) is not None:
                raise trial.broken("endings", reason)
            for cause in step.cause[step.done]:
                name = game.layout.causes[cause]
                ended[name] = ended.get(name, 0) + 1
            clock[step.done] = 0
    if not ended:
        trial.skipped.append(f"endings: no game ended within {LONGEST} steps of random play")
    trial.endings = ended


def _contradiction(step: GameStep, game: Game, clock: Array) -> str | None:
    done, going = step.done, ~step.done
    if not np.isin(step.winner, (0, 1, NO_WINNER)).all():
        return f"winner must be 0, 1 or {NO_WINNER}, got {sorted(set(step.winner.tolist()))}"
    if (step.winner[going] != NO_WINNER).any():
        return "a game that goes on has a winner"
    if not ((step.cause[done] >= 0) & (step.cause[done] < len(game.layout.causes))).all():
        return f"cause must index the {len(game.layout.causes)} causes where a game ended"
    if (step.sparse[:, going] != 0).any():
        return "sparse must be zero while a game goes on"
    if (step.lengths != clock).any():
        return f"lengths must count the steps of each game, this one included: {step.lengths} for {clock}"
    if (clock[going] >= game.layout.max_steps).any():
        return f"a game went on after max_steps ({game.layout.max_steps})"
    return None
