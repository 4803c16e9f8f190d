"""A PettingZoo environment as a batched game."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from apil_core.api.game import NO_WINNER, Array, Game, GameLayout, GameStep
from apil_core.common.colours import Colour
from apil_core.common.errors import ApilError, ConfigError, PluginError, failures, reason_of
from apil_core.games.pettingzoo.bundle import CAUSES, DIVERGED, GOES_ON, TIME_UP, UNSAID
from apil_core.games.pettingzoo.bundles import Bundles
from apil_core.games.pettingzoo.history import History
from apil_core.games.pettingzoo.maker import Maker, prints_to_stderr
from apil_core.games.pettingzoo.options import PettingZooOptions
from apil_core.games.pettingzoo.picture import fitted
from apil_core.games.pettingzoo.repeatable import check_repeatable
from apil_core.games.pettingzoo.spaces import Seat

PRIZE = 1000.0
"""Sparse reward of the winner; the loser gets minus that, a tie nothing."""


class PettingZooGame(Game):
    """``num_envs`` environments; a game ends with its environment, at ``max_steps``, or on NaN or infinity.

    An environment's rewards are the dense stream. Every game has its own seed, drawn here, so results
    depend neither on the number of workers nor on the other games.

    Args:
        num_envs: number of games.
        threads: number of worker processes; 0: as many as CPUs, 1: none.
        options: see :class:`PettingZooOptions`.
        target: ``"module:callable"``.

    Raises:
        ConfigError: the target is missing or not a two-player game.
    """

    def __init__(
        self, num_envs: int, threads: int = 1, options: PettingZooOptions | None = None, target: str = ""
    ):
        options = options or PettingZooOptions()
        self.num_envs = num_envs
        self.name = f"game pettingzoo:{target}"
        self._winner_by = options.winner
        self._maker = maker = Maker.find(target, options.kwargs)
        seats = self._look(maker)
        self.layout = self._layout(seats, options)
        self._seats = seats
        self._bundles = Bundles(maker, seats, num_envs, threads)
        self._history = History(num_envs, [seat.actions for seat in seats])
        self._clock = np.zeros(num_envs, np.int32)
        self._over = np.ones(num_envs, bool)
        self._totals = np.zeros((2, num_envs))
        first, second = (np.zeros((num_envs, seat.size), np.float32) for seat in seats)
        self._observations = (first, second)
        self._rng = np.random.default_rng(0)

    @property
    def packages(self) -> tuple[str, ...]:
        """Versions of PettingZoo and of the distribution with the module."""
        return ("pettingzoo", *self._maker.packages)

    @property
    def observations(self) -> tuple[Array, Array]:
        """See :class:`apil_core.Game`."""
        return self._observations

    def seed(self, seed: int) -> None:
        """See :class:`apil_core.Game`."""
        self._rng = np.random.default_rng(seed)

    def reset(self, mask: Array | None = None) -> None:
        """See :class:`apil_core.Game`.

        Raises:
            PluginError: the environment fails.
        """
        mask = np.ones(self.num_envs, bool) if mask is None else np.asarray(mask, bool)
        if not mask.any():
            return
        seeds = np.full(self.num_envs, -1, np.int64)
        seeds[mask] = self._rng.integers(2**31, size=int(mask.sum()))
        self._take(self._bundles.reset(seeds), mask)
        self._history.begin(mask, seeds)
        self._clock[mask] = 0
        self._totals[:, mask] = 0
        self._over[mask] = False

    def step(self, actions: tuple[Array, Array], active: Array | None = None) -> GameStep:
        """See :class:`apil_core.Game`.

        Raises:
            ApilError: no game was ever reset.
            PluginError: the environment fails.
        """
        playing = ~self._over if active is None else ~self._over & active
        if self._history.empty:
            raise ApilError(f"{self.name}: call reset() before the first step()")
        native = self._native(actions)
        self._history.add(native, self._clock, playing)
        shown = self._bundles.step(native, playing)
        self._take(shown, playing)
        self._clock += playing
        step = self._score(shown, playing)
        self._over |= step.done
        return step

    def state_dict(self) -> dict[str, Any]:
        """See :class:`apil_core.Game`: the seeds and actions of the games."""
        return {
            **self._history.state_dict(self._clock),
            "clock": self._clock.copy(),
            "over": self._over.copy(),
            "totals": self._totals.copy(),
            "observations": {str(side): row.copy() for side, row in enumerate(self._observations)},
            "random": json.dumps(self._rng.bit_generator.state),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`apil_core.Game`: replays the games up to the stored step.

        Raises:
            PluginError: the replay differs, so the environment is not determined by its seed.
        """
        self._clock[...] = state["clock"]
        self._over[...] = state["over"]
        self._totals[...] = state["totals"]
        self._rng.bit_generator.state = json.loads(state["random"])
        self._history.load_state_dict(state)
        saved = tuple(np.empty_like(array) for array in self._observations)
        for side, array in enumerate(saved):
            array[...] = state["observations"][str(side)]
        running = ~self._over
        if running.any():
            self._replay(running)
        for reached, wanted in zip(self._observations, saved, strict=True):
            if not np.array_equal(reached[running], wanted[running]):
                raise PluginError(
                    f"{self.name}: games played again from their seeds come out differently, so the run "
                    "cannot go on exactly; reset(seed=) must decide everything random"
                )
        self._observations = (saved[0], saved[1])

    def render(self, row: int, width: int, height: int, colours: tuple[Colour, Colour]) -> Array:
        """See :class:`apil_core.Game`; the environment ignores ``colours``.

        Raises:
            ApilError: it returns no picture.
        """
        try:
            return fitted(self._bundles.picture(row), width, height)
        except ApilError as error:
            raise ApilError(f"{self.name}: {error}") from error

    def close(self) -> None:
        """End the worker processes."""
        self._bundles.close()

    # --- details

    def _look(self, maker: Maker) -> tuple[Seat, Seat]:
        """Both seats, from a temporary environment."""
        env = maker.checked()
        try:
            self.seconds_per_step = 1 / float(env.metadata.get("render_fps") or 20)
            first, second = (
                Seat.of(agent, env.observation_space(agent), env.action_space(agent))
                for agent in env.possible_agents
            )
            with prints_to_stderr():
                check_repeatable(env, (first, second))
        except ConfigError as error:
            raise ConfigError(f"{self.name}: {error}") from error
        except failures() as error:
            raise ConfigError(f"{self.name}: a first trial failed: {reason_of(error)}") from error
        finally:
            env.close()
        return first, second

    def _layout(self, seats: tuple[Seat, Seat], options: PettingZooOptions) -> GameLayout:
        agents = [seat.agent for seat in seats]
        unknown = [agent for agent in options.opponent_channels if agent not in agents]
        if unknown:
            known = ", ".join(agents)
            raise ConfigError(f"{self.name}: opponent_channels: no agent {unknown[0]!r} (known: {known})")
        try:
            first, second = (seat.layout(options.opponent_channels.get(seat.agent, ())) for seat in seats)
        except ConfigError as error:
            raise ConfigError(f"{self.name}: {error}") from error
        return GameLayout((first, second), options.max_steps, CAUSES)

    def _native(self, actions: tuple[Array, Array]) -> tuple[Array, Array]:
        parts = zip(self._seats, actions, self._observations, strict=True)
        first, second = (seat.native(given, seen) for seat, given, seen in parts)
        return first, second

    def _take(self, shown: dict[str, Array], rows: Array) -> None:
        """Allocate new arrays, so that those returned earlier keep their content."""
        first, second = (
            np.where(rows[:, None], shown[f"observation_{side}"], self._observations[side]) for side in (0, 1)
        )
        self._observations = (first, second)

    def _replay(self, running: Array) -> None:
        self._take(self._bundles.reset(np.where(running, self._history.seeds, -1)), running)
        for time in range(int(self._clock[running].max())):
            playing = running & (time < self._clock)
            self._take(self._bundles.step(self._history.at(time), playing), playing)

    def _score(self, shown: dict[str, Array], playing: Array) -> GameStep:
        cause = np.where(playing, shown["cause"], np.int8(GOES_ON))
        late = playing & (cause == GOES_ON) & (self._clock >= self.layout.max_steps)
        cause[late] = TIME_UP
        done = cause != GOES_ON
        reward = np.where(playing, shown["reward"].T, 0.0)
        self._totals += reward
        winner = np.where(done & (cause != DIVERGED), self._winner(shown, done & ~late), np.int8(NO_WINNER))
        lead = np.select([winner == 0, winner == 1], [PRIZE, -PRIZE])
        dense = reward.astype(np.float32)
        return GameStep(
            sparse=np.stack([lead, -lead]).astype(np.float32),
            dense=dense,
            shaping=dense.copy(),
            done=done,
            winner=winner.astype(np.int8),
            cause=cause.astype(np.int8),
            lengths=self._clock.copy(),
        )

    def _winner(self, shown: dict[str, Array], ended: Array) -> Array:
        """Winner of every game if it ended now, (n,); ``ended`` marks those the environment ended."""
        if self._winner_by == "reward":
            first, second = self._totals
            return np.select([first > second, second > first], [0, 1], NO_WINNER)
        said = shown["winner"]
        if (ended & (said == UNSAID) & (shown["cause"] != DIVERGED)).any():
            raise PluginError(
                f"{self.name}: winner=info, but a game ended without 'winner' in the agents' infos; "
                "let them say it, or set game.winner=reward"
            )
        return np.where(said == UNSAID, NO_WINNER, said)
