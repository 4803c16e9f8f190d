"""A strip of snapshots: a row of pictures for every game, from its start to its end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from apil_core.common.errors import ApilError
from apil_core.common.files import write_atomically
from apil_core.evaluation.video import overlay as caption
from apil_core.evaluation.video.overlay import Cast

FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}
"""File formats by extension."""

LONGEST = {"PNG": 100_000, "JPEG": 65_500, "WEBP": 16_383}
"""Pixels a strip may be wide or high, by format."""

MOST = 50
"""Pictures a row may have."""

_AREA = 150_000_000  # pixels of a whole strip; six bytes each while it is put together

_GAP = 4  # pixels of white between pictures
_LARGER = 1.4  # letters of the scoreboard to those in the pictures


def check_strip(path: Path, snapshots: int, games: int, size: tuple[int, int]) -> None:
    """Whether such a strip can be written there.

    Args:
        path: of the file.
        snapshots, games: pictures in a row, and rows.
        size: of a picture, pixels.

    Raises:
        ApilError: it cannot.
    """
    if path.suffix.lower() not in FORMATS:
        raise ApilError(f"{path}: snapshots are written to {', '.join(FORMATS)} files")
    if not 1 <= snapshots <= MOST:
        raise ApilError(f"--snapshots takes 1 to {MOST}, got {snapshots}")
    width, height = _sheet(snapshots, games, *size)
    if max(width, height) > LONGEST[FORMATS[path.suffix.lower()]] or width * height > _AREA:
        raise ApilError(
            f"{path}: a strip of {width} × {height} pixels is too large; take fewer --snapshots or "
            "--episodes, or a smaller --width and --height"
        )


def chosen_steps(steps: int, snapshots: int) -> list[int]:
    """Evenly spread steps from 0 to ``steps``, both included; a single one is the last."""
    if snapshots == 1:
        return [steps]
    return sorted({int(step) for step in np.linspace(0, steps, snapshots).round()})


class Strip:
    """Collects pictures of one size and lays them out.

    Args:
        snapshots: pictures in a row.
    """

    def __init__(self, snapshots: int):
        self.snapshots = snapshots
        self.rows: list[list[Image.Image]] = []

    def begin(self) -> None:
        """Start a new row, for a new game."""
        self.rows.append([])

    def add(self, picture: Image.Image) -> None:
        """Append a picture to the last row."""
        self.rows[-1].append(picture)

    def picture(self, cast: Cast) -> Image.Image:
        """All rows below the scoreboard, (rows · height + board) × (snapshots · width)."""
        width, height = self.rows[0][0].size
        columns = max(len(row) for row in self.rows)
        sheet = _sheet(columns, len(self.rows), width, height)
        board = caption.board(sheet[0], caption.letter_size(self.rows[0][0]) * _LARGER, cast)
        image = Image.new("RGB", (sheet[0], sheet[1] + board.height), "white")
        image.paste(board.convert("RGB"), (0, 0))
        for i, row in enumerate(self.rows):
            for j, picture in enumerate(row):
                image.paste(picture, (j * (width + _GAP), board.height + i * (height + _GAP)))
        return image

    def save(self, path: Path, cast: Cast) -> None:
        """Write the file.

        Raises:
            RunDirError: it cannot be written.
        """
        image, kind = self.picture(cast), FORMATS[path.suffix.lower()]
        write_atomically(path, lambda file: image.save(file, format=kind))


def _sheet(columns: int, rows: int, width: int, height: int) -> tuple[int, int]:
    """Width and height of all pictures together, without the scoreboard."""
    return columns * (width + _GAP) - _GAP, rows * (height + _GAP) - _GAP
