"""The checks of ``apil_core.Game``, one function each; each raises ContractError."""

from __future__ import annotations

import copy
import io
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout

import numpy as np

from apil_core.common.errors import ApilError, failures
from apil_core.testing.checks import checking
from apil_core.testing.game_facts import LONGEST, arrays, endings, layout
from apil_core.testing.game_play import GAMES, Play, Trial, plain, same, snapshot


@checking("seeds")
def seeds(trial: Trial) -> None:
    """Check that one seed gives the same games at several numbers of threads, and another seed others."""
    traces = {}
    for threads in (1, 2, 4):
        with trial.game(threads=threads, seed=7) as game:
            play = Play(game, 1)
            play.run(30)
            traces[threads] = play.trace
        equal = same(traces[1], play.trace)
        trial.need(equal, f"1 and {threads} threads give other games for the same seed")
    with trial.game(2, seed=1) as one, trial.game(2, seed=2) as two:
        if same(one.observations, two.observations):
            trial.skipped.append(
                "another seed: seeds 1 and 2 begin alike; a game may, if its starts are fixed"
            )


@checking("save")
def save(trial: Trial) -> None:
    """Check that a saved state, as a dict, continues bit for bit, past the first restarts."""
    with trial.game(seed=3) as game, trial.game(seed=None) as other:
        first = Play(game, 5)
        first.run(27)
        state = copy.deepcopy(game.state_dict())
        trial.need(plain(state), "state_dict must hold arrays, numbers, strings and dicts of them only")
        second = Play(other)
        second.rng.bit_generator.state = copy.deepcopy(first.rng.bit_generator.state)
        other.load_state_dict(state)
        equal = same(game.observations, other.observations)
        trial.need(equal, "observations right after load_state_dict are not those saved")
        first.trace.clear()
        first.run(35)
        second.run(35)
        trial.need(same(first.trace, second.trace), "after load_state_dict the game does not go on as it did")


@checking("reset")
def reset(trial: Trial) -> None:
    """Check that a reset of half of the rows changes these only."""
    with trial.game() as game:
        Play(game).run(3)
        before = snapshot(game)
        mask = np.arange(GAMES) % 2 == 0
        game.reset(mask)
        trial.need(same(before, game.observations, ~mask), "rows outside of the mask changed")
        pairs = zip(before, game.observations, strict=True)
        anew = all((old[mask] != new[mask]).any(axis=1).all() for old, new in pairs)
        trial.need(anew, "a row of the mask did not start anew")


@checking("inactive")
def inactive(trial: Trial) -> None:
    """Check that games continue unchanged while others are held inactive."""
    active = np.arange(GAMES) < 4
    with trial.game(seed=2) as held, trial.game(seed=2) as free:
        play = Play(free, 4)
        for _ in range(5):
            actions = play.actions()
            before = snapshot(held)
            step, full = held.step(actions, active), free.step(actions)
            still = not step.done[~active].any() and (step.lengths[~active] == 0).all()
            trial.need(still, "a held game ended, or its clock went on")
            unpaid = all((paid[:, ~active] == 0).all() for paid in (step.sparse, step.dense, step.shaping))
            trial.need(unpaid, "a held game has rewards")
            equal = np.array_equal(step.dense[:, active], full.dense[:, active])
            trial.need(equal, "active games are paid differently beside held ones")
            trial.need(same(before, held.observations, ~active), "observations of held games changed")
            equal = same(held.observations, free.observations, active)
            trial.need(equal, "active games went another way than without held ones")
    with trial.game() as game:
        step = game.step(Play(game).actions(), np.zeros(GAMES, bool))
        moved = step.done.any() or step.lengths.any()
        trial.need(not moved, "a first step without active games must move nothing")


@checking("ended")
def ended(trial: Trial) -> None:
    """Check that ended games neither end again nor give rewards until they are reset."""
    with trial.game() as game:
        play = Play(game)
        over = np.zeros(GAMES, bool)
        for _ in range(min(game.layout.max_steps, LONGEST) + 10):
            step = game.step(play.actions())
            once = not (step.done & over).any() and (step.dense[:, over] == 0).all()
            trial.need(once, "a game that had ended ended again, or was paid again")
            over |= step.done
        if not over.all():
            trial.skipped.append(f"ended games: not all ended within {LONGEST} steps")
            return
        game.reset()
        begun = (game.step(play.actions()).lengths == 1).all()
        trial.need(begun, "after reset() not all games are in their first step")


@checking("bounds")
def bounds(trial: Trial) -> None:
    """Check that actions out of bounds are clipped to the bounds."""
    with trial.game(seed=5) as wild, trial.game(seed=5) as tame:
        play, (left, right) = Play(wild), wild.layout.sides
        for _ in range(3):
            first, second = (100 * actions for actions in play.actions())
            wild.step((first, second))
            tame.step(
                (
                    np.clip(first, left.action_low, left.action_high),
                    np.clip(second, right.action_low, right.action_high),
                )
            )
            equal = same(wild.observations, tame.observations)
            trial.need(equal, "an action out of bounds is not clipped to them")


@checking("beside")
def beside(trial: Trial) -> None:
    """Check that games do not depend on the actions in other games of the batch."""
    mine = np.arange(GAMES) < 2
    with trial.game(seed=6) as left, trial.game(seed=6) as right:
        play, others = Play(left, 1), Play(right, 2)
        for _ in range(3):
            actions, alien = play.actions(), others.actions()
            first, second = (np.where(mine[:, None], a, b) for a, b in zip(actions, alien, strict=True))
            left.step(actions)
            right.step((first, second))
            equal = same(left.observations, right.observations, mine)
            trial.need(equal, "what other games' players do changes a game")


@checking("buffers")
def buffers(trial: Trial) -> None:
    """Check that returned arrays do not change at the next step."""
    with trial.game() as game:
        play = Play(game)
        for _ in range(3):
            kept, copies = game.observations, snapshot(game)
            game.step(play.actions())
            trial.need(same(kept, copies), "a step overwrites the observations handed out before it")


@checking("first")
def first(trial: Trial) -> None:
    """Check that a step before the first reset raises an ApilError that names ``reset``."""
    with trial.game(1, seed=None) as game:
        try:
            game.step(Play(game).actions())
        except ApilError as error:
            trial.need("reset" in str(error), f"the error must say that reset() is missing: {error}")
        except failures() as error:
            raise trial.failed(f"it must be an ApilError, got {type(error).__name__}") from error
        else:
            raise trial.failed("step() before reset() went through")


@checking("one")
def one(trial: Trial) -> None:
    """Check a single game."""
    with trial.game(1) as game:
        shape = Play(game).run(25).done.shape
        trial.need(shape == (1,), f"GameStep.done must be (1,), got {shape}")


@checking("views")
def views(trial: Trial) -> None:
    """Check the views of a single game with PettingZoo's and Gymnasium's checkers."""
    from gymnasium.utils.env_checker import check_env
    from pettingzoo.test import parallel_api_test, parallel_seed_test

    from apil_core.games.views import OpponentInsideEnv, ParallelGameEnv
    from apil_core.policies.baseline import load

    def fresh() -> ParallelGameEnv:
        return ParallelGameEnv(trial.make(1, 1))

    with warnings.catch_warnings(), redirect_stdout(io.StringIO()):  # PettingZoo's prints
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
