"""The contract of a game: ``num_envs`` two-player games stepped together, in numpy.

The rules exist once, here in batched form; :mod:`apil_core.games.views` shows the same object as a
PettingZoo ``ParallelEnv`` and as a Gymnasium ``Env``, :mod:`apil_core.training.attack_env` as the trainer's
``VecEnv``. This module does not import torch.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from apil_core.common.colours import Colour
from apil_core.common.errors import ApilError

Array = NDArray[Any]


NO_WINNER = -1
"""Value of :attr:`GameStep.winner` for a tie and for a game that has not ended."""


@dataclass(frozen=True)
class SideLayout:
    """Sizes and meaning of what one side sees and does.

    Attributes:
        name: e.g. ``"kicker"``.
        observation_size: length of its flat observation.
        action_size: length of its continuous action.
        action_low, action_high: bounds of every action component (the game clips to them). Infinite ones
            mean that the components are scores of choices, of which the game takes the largest.
        blocks: named parts of the observation, in order; they tile it without gaps.
        opponent_channels: indices of the observation that depend on the opponent (blinding).
    """

    name: str
    observation_size: int
    action_size: int
    action_low: float
    action_high: float
    blocks: dict[str, slice] = field(default_factory=dict)
    opponent_channels: tuple[int, ...] = field(default=(), compare=False)  # not sizes

    @property
    def action_limit(self) -> float:
        """The largest action of a component, to either side; 10 for scores, which have no bound."""
        return 10.0 if self.discrete else max(abs(self.action_low), abs(self.action_high))

    @property
    def discrete(self) -> bool:
        """True if an action is one score per choice."""
        return math.isinf(self.action_high)


@dataclass(frozen=True)
class GameLayout:
    """Constants of a game: both sides, the step limit and the names of endings.

    ``causes`` are short kebab-case names of the ways a game can end, e.g. ``("goal", "time-up",
    "diverged")``; :attr:`GameStep.cause` indexes them.
    """

    sides: tuple[SideLayout, SideLayout]
    max_steps: int
    causes: tuple[str, ...]


@dataclass
class GameStep:
    """Result of one step of all games. Valid until the next call of ``step``.

    Attributes:
        sparse: outcome reward per side, shape (2, num_envs), float32; zero until a game ends.
        dense: movement reward per side as the original games return it, shape (2, num_envs);
            ``sparse + dense`` is a side's returned reward.
        shaping: the dense stream training uses, shape (2, num_envs); equals ``dense`` in most games.
        done: shape (num_envs,), bool: the game ended with this step. Time-outs are outcomes.
        winner: shape (num_envs,), int8: 0 or 1 where a side won with this step, else ``NO_WINNER``.
        cause: shape (num_envs,), int8: index into ``GameLayout.causes`` where ``done``.
        lengths: shape (num_envs,), int32: steps played in each game, this one included.
    """

    sparse: Array
    dense: Array
    shaping: Array
    done: Array
    winner: Array
    cause: Array
    lengths: Array


class Window(ABC):
    """A game on the screen."""

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """True until the user closes the window."""

    @abstractmethod
    def show(self, caption: str) -> None:
        """Draw the game's current state, with that text."""

    @abstractmethod
    def close(self) -> None:
        """Close the window; may be called twice."""


class Game(ABC):
    """``num_envs`` independent games of one kind.

    All randomness comes from one ``numpy.random.Generator`` set by :meth:`seed`, so a seed gives
    the same games bit for bit at any number of threads.
    """

    layout: GameLayout
    num_envs: int
    seconds_per_step: float = 0.05
    """Simulated time of a control step, s; sets the speed of videos."""

    @property
    def packages(self) -> tuple[str, ...]:
        """Distributions that implement this game; their versions are stored with every score."""
        return ()

    @property
    def settings(self) -> dict[str, Any]:
        """Options with the profile's values filled in, ``physics`` naming the profile; stored with scores."""
        return {}

    @abstractmethod
    def seed(self, seed: int) -> None:
        """Restart the game's random generator."""

    @abstractmethod
    def reset(self, mask: Array | None = None) -> None:
        """Start new games where ``mask`` (num_envs,) is true (everywhere if ``None``).

        Only those rows of :attr:`observations` change.
        """

    @property
    @abstractmethod
    def observations(self) -> tuple[Array, Array]:
        """Current observations of side 0 and 1, each (num_envs, observation_size) float32.

        The arrays returned before a call of :meth:`step` keep their content until the call
        after it, so that a transition needs no copy (two buffers in turn will do).
        """

    @abstractmethod
    def step(self, actions: tuple[Array, Array], active: Array | None = None) -> GameStep:
        """Advance every game by one control step; ended games stay ended until :meth:`reset`.

        Args:
            actions: of side 0 and 1, each (num_envs, action_size); clipped to the bounds here.
            active: (num_envs,) bool, games to advance; the others keep their state, report
                ``done=False`` and zero rewards. ``None``: all.
        """

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Everything :meth:`load_state_dict` needs to resume bit for bit: physics, rules, clock,
        observations and the random generator. Values: numpy arrays, numbers, strings, dicts."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`, on a game made with the same arguments."""

    def render(self, row: int, width: int, height: int, colours: tuple[Colour, Colour]) -> Array:
        """Draw the current state of one game; does not change it.

        Args:
            row: which game.
            width, height: of the picture, pixels.
            colours: of side 0 and 1.

        Returns:
            (height, width, 3) uint8.

        Raises:
            ApilError: this game cannot be drawn, or not on this machine.
        """
        raise ApilError(f"{type(self).__name__} cannot be drawn: it has no render()")

    def open_window(self, row: int, colours: tuple[Colour, Colour]) -> Window:
        """Show one game on the screen.

        Raises:
            ApilError: this game has no window, or this machine no screen.
        """
        raise ApilError(f"{type(self).__name__} has no window of its own")

    def physics_stopwatch(self) -> PhysicsStopwatch | None:
        """A stopwatch for the physics of this game alone, or ``None`` if it cannot be timed separately.

        The caller closes it before the game.
        """
        return None

    def close(self) -> None:  # noqa: B027  (optional)
        """Release threads, processes or windows."""


class PhysicsStopwatch(ABC):
    """Stopwatch of a game's physics: records the start state of every physics call and times replays.

    A rate means little on a machine that is never idle; a ratio to the same work, seconds apart, does.
    """

    @abstractmethod
    def record(self) -> None:
        """Clear the record and start recording every physics call of the game."""

    @abstractmethod
    def stop(self) -> float:
        """Stop recording.

        Returns:
            seconds spent recording since :meth:`record`; they are part of any time measured meanwhile.
        """

    @abstractmethod
    def replay(self) -> float:
        """Repeat the recorded calls in order, on as many threads; does not change the game.

        Returns:
            seconds the calls took, without the time to restore their start states.
        """

    @abstractmethod
    def close(self) -> None:
        """Detach from the game's physics and drop the record; may be called twice."""
