"""The checks of ``apil_core.Game``, one function each; each raises ContractError."""

from __future__ import annotations

import copy
import io
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout

import numpy as np

from apil_core.api.game import Array, GameStep
from apil_core.common.errors import ApilError, failures
from apil_core.testing.checks import GAME_CHECKS, reported_as
from apil_core.testing.game_facts import LONGEST, arrays, endings, layout
from apil_core.testing.game_play import GAMES, Play, Trial, plain, same, same_views, snapshot


def seeds(trial: Trial) -> None:
    """Check that one seed gives the same games at several numbers of threads, and another seed others."""
    plays = []
    for threads in (1, 2, 4):
        with trial.game(threads=threads, seed=7) as game:
            play = Play(game, 1)
            play.run(30)
            plays.append(play)
    for threads, play in zip((2, 4), plays[1:], strict=True):
        if not same(plays[0], play):
            raise trial.broken("seeds", f"1 and {threads} threads give other games for the same seed")
    with trial.game(2, seed=1) as one, trial.game(2, seed=2) as two:
        if same_views(one.observations, two.observations):
            trial.skipped.append(
                "another seed: seeds 1 and 2 begin alike; a game may, if its starts are fixed"
            )


def save(trial: Trial) -> None:
    """Check that a saved state, as a dict, continues bit for bit, past the first restarts."""
    with trial.game(seed=3) as game, trial.game(seed=None) as other:
        first = Play(game, 5)
        first.run(27)
        state = copy.deepcopy(game.state_dict())
        if not plain(state):
            raise trial.broken("save", "state_dict must hold arrays, numbers, strings and dicts of them only")
        second = Play(other)
        second.rng.bit_generator.state = copy.deepcopy(first.rng.bit_generator.state)
        with reported_as(f"game {trial.name!r}", GAME_CHECKS["save"]):
            other.load_state_dict(state)
        if not same_views(game.observations, other.observations):
            raise trial.broken("save", "observations right after load_state_dict are not those saved")
        first.trace.clear()
        first.run(35)
        second.run(35)
        if not same(first, second):
            raise trial.broken("save", "after load_state_dict the game does not go on as it did")


def reset(trial: Trial) -> None:
    """Check that a reset of half of the rows changes these only."""
    with trial.game() as game:
        Play(game).run(3)
        before = snapshot(game)
        mask = np.arange(GAMES) % 2 == 0
        game.reset(mask)
        if not same_views(before, game.observations, ~mask):
            raise trial.broken("reset", "rows outside of the mask changed")
        pairs = zip(before, game.observations, strict=True)
        if not all((old[mask] != new[mask]).any(axis=1).all() for old, new in pairs):
            raise trial.broken("reset", "a row of the mask did not start anew")


def inactive(trial: Trial) -> None:
    """Check that games continue unchanged while others are held inactive."""
    active = np.arange(GAMES) < 4
    with trial.game(seed=2) as held, trial.game(seed=2) as free:
        play = Play(free, 4)
        for _ in range(5):
            actions = play.actions()
            before = snapshot(held)
            step, full = held.step(actions, active), free.step(actions)
            if (reason := _disturbed(step, full, active)) is not None:
                raise trial.broken("inactive", reason)
            if not same_views(before, held.observations, ~active):
                raise trial.broken("inactive", "observations of held games changed")
            if not same_views(held.observations, free.observations, active):
                raise trial.broken("inactive", "active games went another way than without held ones")
    with trial.game() as game:
        step = game.step(Play(game).actions(), np.zeros(GAMES, bool))
        if step.done.any() or step.lengths.any():
            raise trial.broken("inactive", "a first step without active games must move nothing")


def _disturbed(step: GameStep, full: GameStep, active: Array) -> str | None:
    if step.done[~active].any() or (step.lengths[~active] != 0).any():
        return "a held game ended, or its clock went on"
    if any((reward[:, ~active] != 0).any() for reward in (step.sparse, step.dense, step.shaping)):
        return "a held game has rewards"
    if not np.array_equal(step.dense[:, active], full.dense[:, active]):
        return "active games are paid differently beside held ones"
    return None


def ended(trial: Trial) -> None:
    """Check that ended games neither end again nor give rewards until they are reset."""
    with trial.game() as game:
        play = Play(game)
        over = np.zeros(GAMES, bool)
        for _ in range(min(game.layout.max_steps, LONGEST) + 10):
            step = game.step(play.actions())
            if (step.done & over).any() or (step.dense[:, over] != 0).any():
                raise trial.broken("ended", "a game that had ended ended again, or was paid again")
            over |= step.done
        if not over.all():
            trial.skipped.append(f"ended games: not all ended within {LONGEST} steps")
            return
        game.reset()
        if (game.step(play.actions()).lengths != 1).any():
            raise trial.broken("ended", "after reset() not all games are in their first step")


def bounds(trial: Trial) -> None:
    """Check that actions out of bounds are clipped to the bounds."""
    with trial.game(seed=5) as wild, trial.game(seed=5) as tame:
        play = Play(wild)
        for _ in range(3):
            far = [100 * actions for actions in play.actions()]
            near = [
                np.clip(actions, side.action_low, side.action_high)
                for actions, side in zip(far, wild.layout.sides, strict=True)
            ]
            wild.step((far[0], far[1]))
            tame.step((near[0], near[1]))
            if not same_views(wild.observations, tame.observations):
                raise trial.broken("bounds", "an action out of bounds is not clipped to them")


def beside(trial: Trial) -> None:
    """Check that games do not depend on the actions in other games of the batch."""
    mine = np.arange(GAMES) < 2
    with trial.game(seed=6) as left, trial.game(seed=6) as right:
        play, others = Play(left, 1), Play(right, 2)
        for _ in range(3):
            actions, alien = play.actions(), others.actions()
            mixed = [np.where(mine[:, None], a, b) for a, b in zip(actions, alien, strict=True)]
            left.step(actions)
            right.step((mixed[0], mixed[1]))
            if not same_views(left.observations, right.observations, mine):
                raise trial.broken("beside", "what other games' players do changes a game")


def buffers(trial: Trial) -> None:
    """Check that returned arrays do not change at the next step."""
    with trial.game() as game:
        play = Play(game)
        for _ in range(3):
            kept, copies = game.observations, snapshot(game)
            game.step(play.actions())
            if not same_views(kept, copies):
                raise trial.broken("buffers", "a step overwrites the observations handed out before it")


def first(trial: Trial) -> None:
    """Check that a step before the first reset raises an ApilError that names ``reset``."""
    with trial.game(1, seed=None) as game:
        try:
            game.step(Play(game).actions())
        except ApilError as error:
            if "reset" not in str(error):
                raise trial.broken("first", f"the error must say that reset() is missing: {error}") from error
        except failures() as error:
            raise trial.broken("first", f"it must be an ApilError, got {type(error).__name__}") from error
        else:
            raise trial.broken("first", "step() before reset() went through")


def one(trial: Trial) -> None:
    """Check a single game."""
    with trial.game(1) as game, reported_as(f"game {trial.name!r}", GAME_CHECKS["one"]):
        step = Play(game).run(25)
        if step.done.shape != (1,):
            raise trial.broken("one", f"GameStep.done must be (1,), got {step.done.shape}")


def views(trial: Trial) -> None:
    """Check the views of a single game with PettingZoo's and Gymnasium's checkers."""
    from gymnasium.utils.env_checker import check_env
    from pettingzoo.test import parallel_api_test, parallel_seed_test

    from apil_core.games.views import OpponentInsideEnv, ParallelGameEnv
    from apil_core.policies.baseline import load

    def fresh() -> ParallelGameEnv:
        return ParallelGameEnv(trial.make(1, 1))

    who, silence = f"game {trial.name!r}", redirect_stdout(io.StringIO())  # PettingZoo's prints
    with warnings.catch_warnings(), reported_as(who, GAME_CHECKS["views"]), silence:
        warnings.simplefilter("error", UserWarning)
        parallel_api_test(fresh(), num_cycles=30)
        parallel_seed_test(fresh, num_cycles=30)
        warnings.simplefilter("ignore", UserWarning)  # Gymnasium's of infinite bounds, which are meant
        for side in (0, 1):
            game = trial.make(1, 1)
            other = game.layout.sides[1 - side]
            opponent = load(f"random/{other.observation_size}x{other.action_size}")
            check_env(OpponentInsideEnv(game, opponent, side=side), skip_render_check=True)


CHECKS: dict[str, Callable[[Trial], None]] = {
    check.__name__: check
    for check in (
        *(layout, arrays, endings, seeds, save, reset, inactive),
        *(ended, bounds, beside, buffers, first, one, views),
    )
}
"""All checks of :data:`apil_core.testing.checks.GAME_CHECKS` but ``spec``, by key."""
