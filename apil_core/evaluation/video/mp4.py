"""mp4 files, written frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from types import ModuleType

from PIL import Image

from apil_core.common.errors import ApilError
from apil_core.common.extras import need

CODECS = ("libx264", "libopenh264", "h264")
"""H.264 encoders, the first that this PyAV has."""

_QUALITY = {"crf": "20"}


def pace(seconds_per_step: float, speed: float, fps: float) -> tuple[int, Fraction]:
    """Steps per frame, and frames per second.

    Steps are skipped rather than frames repeated: at 0.015 s a step and 30 fps every other step is
    shown, 33.3 per second.

    Args:
        seconds_per_step: simulated time of a step, s.
        speed: 1 is real time, 0.5 slow motion.
        fps: desired frame rate, approximate.
    """
    shown = seconds_per_step / speed
    stride = max(1, round(1 / (fps * shown)))
    return stride, Fraction(1 / (stride * shown)).limit_denominator(1000)


def check_mp4(path: Path, width: int, height: int) -> None:
    """Check that a video can be written there.

    Raises:
        ApilError: PyAV is missing, or path or size are unsuitable.
    """
    if _codec(need("av")) is None:
        raise ApilError("this build of PyAV has no H.264 encoder; its wheels have: pip install av")
    if path.suffix.lower() != ".mp4":
        raise ApilError(f"{path}: videos are .mp4 files")
    if width % 2 or height % 2:
        raise ApilError(f"a video's width and height must be even, got {width} × {height}")


class Mp4Writer:
    """An H.264 video in an mp4 file, which exists after :meth:`close`.

    Args:
        path: of the file.
        width, height: of the frames, pixels, even.
        rate: frames per second.

    Raises:
        ApilError: the file cannot be written; so do :meth:`add` and :meth:`close`.
    """

    def __init__(self, path: Path, width: int, height: int, rate: Fraction):
        self.path = path
        self.rate = rate
        self.frames = 0
        self._av = need("av")
        self._part = path.with_name(f".{path.name}.part")
        with self._writing():
            self._container = self._av.open(str(self._part), "w", format="mp4")
            self._stream = self._container.add_stream(_codec(self._av), rate=rate, options=_QUALITY)
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"

    def add(self, picture: Image.Image, seconds: float = 0.0) -> None:
        """Append a picture: one frame, or as many as fill so many seconds."""
        for _ in range(max(1, round(seconds * self.rate))):
            with self._writing():
                self._container.mux(self._stream.encode(self._av.VideoFrame.from_image(picture)))
            self.frames += 1

    def close(self) -> None:
        """Finish the file."""
        with self._writing():
            self._container.mux(self._stream.encode())
            self._container.close()
            self._part.replace(self.path)

    def discard(self) -> None:
        """Delete the partial file."""
        with suppress(self._av.error.FFmpegError):  # a file that could not be written need not be finished
            self._container.close()
        self._part.unlink(missing_ok=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (self._av.error.FFmpegError, OSError) as error:
            raise ApilError(f"cannot write {self.path}: {' '.join(str(error).split())}") from error


def _codec(av: ModuleType) -> str | None:
    return next((name for name in CODECS if name in av.codecs_available), None)
