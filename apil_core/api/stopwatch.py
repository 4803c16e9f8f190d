"""Timing a game's physics alone, for ``apil bench speed``; see :meth:`apil_core.Game.physics_stopwatch`."""

from __future__ import annotations

from abc import ABC, abstractmethod


class PhysicsStopwatch(ABC):
    """Keeps what every physics call of a game started from, and times the very same calls alone.

    A rate tells little on a machine that is never quite idle; a ratio to the same work, seconds apart, does.
    """

    @abstractmethod
    def record(self) -> None:
        """Forget what was kept, and keep every physics call of the game from now on."""

    @abstractmethod
    def stop(self) -> float:
        """Keep no more calls.

        Returns:
            seconds that keeping took since :meth:`record`; they are part of whatever was timed meanwhile.
        """

    @abstractmethod
    def replay(self) -> float:
        """Do the kept calls once more, in their order and on as many threads; the game does not notice.

        Returns:
            seconds the calls took, without putting their starting points in place.
        """

    @abstractmethod
    def close(self) -> None:
        """Let the game's physics alone, and drop what was kept; closing twice is fine."""
