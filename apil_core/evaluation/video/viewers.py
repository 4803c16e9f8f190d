"""Viewers of games as they are played: a video, a contact sheet, a window."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from pathlib import Path

from PIL import Image

from apil_core.api.game import Game
from apil_core.common import colours
from apil_core.common.files import write_atomically
from apil_core.evaluation.video import overlay
from apil_core.evaluation.video.contact_sheet import FORMATS, chosen_steps, lay_out
from apil_core.evaluation.video.mp4 import Mp4Writer, pace
from apil_core.evaluation.video.overlay import OverlayText
from apil_core.evaluation.video.single_game import Frame, PlayedGame

HELD = 1.2
"""Duration of a game's last frame, s."""

_LONGEST_SKIP = 0.5  # s without a new picture in a window that cannot keep up


class WindowClosed(Exception):  # noqa: N818  (no error)
    """The user closed the window."""


class Camera:
    """Takes pictures of a game (of one row) at one size.

    Raises:
        ApilError: the game cannot be drawn here.
    """

    def __init__(self, game: Game, adversary_side: int, size: tuple[int, int]):
        self.size = size
        self._game, self._colours = game, colours.by_side(adversary_side)
        self.take()  # before the first game, so that an hour of play cannot end in an error

    def take(self) -> Image.Image:
        """The game as it stands."""
        return Image.fromarray(self._game.render(0, *self.size, self._colours))


class Viewer(ABC):
    """Shows games, one after the other."""

    def begin(self, ahead: PlayedGame | None) -> None:  # noqa: B027  (optional)
        """A game starts; ``ahead`` is its outcome, if it was played before."""

    @abstractmethod
    def see(self, frame: Frame) -> None:
        """Show the game at that frame; counted in the score if it has ended."""

    @abstractmethod
    def finish(self) -> None:
        """All games have been shown."""

    def abandon(self) -> None:  # noqa: B027  (optional)
        """Clean up after an error: delete partial files."""


class VideoRecorder(Viewer):
    """Records the games as an mp4 file.

    Args:
        path: of the video.
        camera: gives the frames.
        text: written into them.
        seconds_per_step: simulated time of a step, s.
        speed, fps: see :func:`apil_core.evaluation.video.mp4.pace`.
    """

    def __init__(
        self, path: Path, camera: Camera, text: OverlayText, seconds_per_step: float, speed: float, fps: float
    ):
        self._camera, self._text = camera, text
        self._stride, rate = pace(seconds_per_step, speed, fps)
        self._file = Mp4Writer(path, *camera.size, rate)

    def see(self, frame: Frame) -> None:
        """See :class:`Viewer`."""
        if frame.step % self._stride and frame.ended is None:
            return
        picture = self._camera.take()
        overlay.scoreboard(picture, self._text)
        overlay.clock(picture, self._text.clock(frame))
        if frame.ended is not None:
            overlay.banner(picture, frame.ended)
        self._file.add(picture, 0.0 if frame.ended is None else HELD)

    def finish(self) -> None:
        """See :class:`Viewer`."""
        self._file.close()

    def abandon(self) -> None:
        """See :class:`Viewer`."""
        self._file.discard()


class ContactSheet(Viewer):
    """Takes evenly spread snapshots of every game, whose length must be known in advance.

    Args:
        path: of the picture.
        camera: gives the snapshots.
        text: written above them.
        snapshots: of each game.
    """

    def __init__(self, path: Path, camera: Camera, text: OverlayText, snapshots: int):
        self._path, self._camera, self._text = path, camera, text
        self._snapshots = snapshots
        self._rows: list[list[Image.Image]] = []
        self._steps: list[int] = []

    def begin(self, ahead: PlayedGame | None) -> None:
        """See :class:`Viewer`."""
        assert ahead is not None
        self._steps = chosen_steps(ahead.steps, self._snapshots)
        self._rows.append([])

    def see(self, frame: Frame) -> None:
        """See :class:`Viewer`."""
        if frame.step not in self._steps:
            return
        picture = self._camera.take()
        if frame.ended is None:
            overlay.clock(picture, f"{frame.seconds:.2f} s")
        else:
            overlay.banner(picture, frame.ended)
        self._rows[-1].append(picture)

    def finish(self) -> None:
        """See :class:`Viewer`."""
        image, kind = lay_out(self._rows, self._text), FORMATS[self._path.suffix.lower()]
        write_atomically(self._path, lambda file: image.save(file, format=kind))


class LiveViewer(Viewer):
    """Shows the games in a window, in real time.

    Args:
        game: to be shown.
        adversary_side: determines the colours.
        text: shown beside it.
        speed: 1 is real time.

    Raises:
        ApilError: no screen, or no window.
    """

    def __init__(self, game: Game, adversary_side: int, text: OverlayText, speed: float):
        self._window = game.open_window(0, colours.by_side(adversary_side))
        self._text, self._speed = text, speed
        self._begun = self._shown = 0.0  # on the clock of time.monotonic

    def see(self, frame: Frame) -> None:
        """See :class:`Viewer`; lasts as long as the frame does, and skips some where drawing is slow.

        Raises:
            WindowClosed: the user closed the window.
        """
        if not self._window.is_open:
            raise WindowClosed
        now, ended = time.monotonic(), frame.ended is not None
        if frame.step == 0:
            self._begun = now
        due = self._begun + frame.seconds / self._speed
        if due > now or ended or frame.step == 0 or now > self._shown + _LONGEST_SKIP:
            self._window.show(self._text.all(frame))
            self._shown = time.monotonic()
        time.sleep(max(0.0, due - time.monotonic()) + (HELD if ended else 0.0))

    def finish(self) -> None:
        """See :class:`Viewer`."""
        self._window.close()

    abandon = finish
