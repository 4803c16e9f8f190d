"""Those a game is shown to: a video, a strip of snapshots, a window."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from pathlib import Path

from PIL import Image

from apil_core.api.game import Game
from apil_core.common import colours
from apil_core.evaluation.video import overlay as caption
from apil_core.evaluation.video.contact_sheet import Strip, chosen_steps
from apil_core.evaluation.video.mp4 import Film, pace
from apil_core.evaluation.video.overlay import Cast
from apil_core.evaluation.video.single_game import Moment, PlayedGame

HELD = 1.2
"""How long the end of a game stays, s."""

_LONGEST_SKIP = 0.5  # s without a new picture in a window that cannot keep up


class WindowClosed(Exception):  # noqa: N818  (no error)
    """The user has seen enough."""


class Camera:
    """Takes pictures of a game (of one row) at one size.

    Raises:
        ApilError: the game cannot be drawn here.
    """

    def __init__(self, game: Game, adversary_side: int, width: int, height: int):
        self._game = game
        self._size = width, height
        self._colours = colours.by_side(adversary_side)
        self.take()  # before anything is played, lest an hour of play ends in an error

    def take(self) -> Image.Image:
        """The game as it stands."""
        return Image.fromarray(self._game.render(0, *self._size, self._colours))


class Audience(ABC):
    """One who watches games."""

    knows_ahead = False
    """Whether :meth:`begin` needs to know how the game will go."""

    def begin(self, ahead: PlayedGame | None) -> None:  # noqa: B027  (optional)
        """A game begins."""

    @abstractmethod
    def see(self, moment: Moment) -> None:
        """Look at the game, which stands at that moment; the score counts it if it has ended."""

    def finish(self) -> None:  # noqa: B027  (optional)
        """All games have been shown."""

    def abandon(self) -> None:  # noqa: B027  (optional)
        """Something went wrong: leave nothing behind."""


class FilmAudience(Audience):
    """Films the games.

    Args:
        path: of the video.
        camera: gives the frames.
        size: of the frames.
        cast: what to write into them.
        seconds_per_step: simulated time of a step, s.
        speed, fps: see :func:`apil_core.evaluation.video.mp4.pace`.
    """

    def __init__(
        self,
        path: Path,
        camera: Camera,
        size: tuple[int, int],
        cast: Cast,
        seconds_per_step: float,
        *,
        speed: float,
        fps: float,
    ):
        self._camera, self._cast = camera, cast
        self._stride, rate = pace(seconds_per_step, speed, fps)
        self.film = Film(path, *size, rate)

    def see(self, moment: Moment) -> None:
        """See :class:`Audience`."""
        if moment.step % self._stride and moment.ended is None:
            return
        picture = self._camera.take()
        caption.scoreboard(picture, self._cast)
        caption.clock(picture, self._cast.clock(moment))
        if moment.ended is not None:
            caption.banner(picture, moment.ended)
        self.film.add(picture, 0.0 if moment.ended is None else HELD)

    def finish(self) -> None:
        """See :class:`Audience`."""
        self.film.close()

    def abandon(self) -> None:
        """See :class:`Audience`."""
        self.film.discard()


class StripAudience(Audience):
    """Takes evenly spread snapshots of every game.

    Args:
        path: of the picture.
        camera: gives the snapshots.
        cast: what to write into them.
        snapshots: of each game.
    """

    knows_ahead = True

    def __init__(self, path: Path, camera: Camera, cast: Cast, snapshots: int):
        self._path, self._camera, self._cast = path, camera, cast
        self._strip = Strip(snapshots)
        self._steps: list[int] = []

    def begin(self, ahead: PlayedGame | None) -> None:
        """See :class:`Audience`."""
        assert ahead is not None
        self._steps = chosen_steps(ahead.steps, self._strip.snapshots)
        self._strip.begin()

    def see(self, moment: Moment) -> None:
        """See :class:`Audience`."""
        if moment.step not in self._steps:
            return
        picture = self._camera.take()
        if moment.ended is None:
            caption.clock(picture, f"{moment.seconds:.2f} s")
        else:
            caption.banner(picture, moment.ended)
        self._strip.add(picture)

    def finish(self) -> None:
        """See :class:`Audience`."""
        self._strip.save(self._path, self._cast)


class WindowAudience(Audience):
    """Shows the games on the screen, at their own speed.

    Args:
        game: to be shown.
        adversary_side: decides the colours.
        cast: what to write beside it.
        speed: 1 is real time.

    Raises:
        ApilError: no screen, or no window.
    """

    def __init__(self, game: Game, adversary_side: int, cast: Cast, speed: float):
        self._window = game.open_window(0, colours.by_side(adversary_side))
        self._cast, self._speed = cast, speed
        self._begun = self._shown = 0.0  # on the clock of time.monotonic

    def see(self, moment: Moment) -> None:
        """See :class:`Audience`; lasts as long as the moment does, and skips some where drawing is slow.

        Raises:
            WindowClosed: the user closed the window.
        """
        if not self._window.is_open:
            raise WindowClosed
        now, ended = time.monotonic(), moment.ended is not None
        if moment.step == 0:
            self._begun = now
        due = self._begun + moment.seconds / self._speed
        if due > now or ended or moment.step == 0 or now > self._shown + _LONGEST_SKIP:
            self._window.show(self._cast.text(moment))
            self._shown = time.monotonic()
        time.sleep(max(0.0, due - time.monotonic()) + (HELD if ended else 0.0))

    def finish(self) -> None:
        """See :class:`Audience`."""
        self._window.close()

    def abandon(self) -> None:
        """See :class:`Audience`."""
        self._window.close()
