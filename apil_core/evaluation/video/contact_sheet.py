"""Contact sheets: a row of snapshots for every game, start to end, below the names and the score."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from apil_core.common.errors import ApilError
from apil_core.evaluation.video import overlay
from apil_core.evaluation.video.overlay import OverlayText

FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}
"""File formats by extension."""

LONGEST = {"PNG": 100_000, "JPEG": 65_500, "WEBP": 16_383}
"""Pixels a contact sheet may be wide or high, by format."""

_AREA = 150_000_000  # pixels of a whole sheet; six bytes each while it is put together

_GAP = 4  # pixels of white between snapshots
_LARGER = 1.4  # letters of the header to those in the snapshots


def check_contact_sheet(path: Path, snapshots: int, games: int, size: tuple[int, int]) -> None:
    """Check that such a contact sheet can be written there.

    Args:
        path: of the file.
        snapshots, games: snapshots in a row, and rows.
        size: of a snapshot, pixels.

    Raises:
        ApilError: it cannot.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise ApilError(f"{path}: snapshots are written to {', '.join(FORMATS)} files")
    width, height = _size(snapshots, games, *size)
    if max(width, height) > LONGEST[kind] or width * height > _AREA:
        raise ApilError(
            f"{path}: a contact sheet of {width} × {height} pixels is too large; take fewer --snapshots or "
            "--episodes, or a smaller --width and --height"
        )


def chosen_steps(steps: int, snapshots: int) -> list[int]:
    """Evenly spread steps from 0 to ``steps``, both included; a single one is the last."""
    if snapshots == 1:
        return [steps]
    return sorted({int(step) for step in np.linspace(0, steps, snapshots).round()})


def lay_out(rows: Sequence[Sequence[Image.Image]], text: OverlayText) -> Image.Image:
    """All rows of equally large snapshots below the header, (rows · height + header) × (columns · width)."""
    width, height = rows[0][0].size
    sheet = _size(max(map(len, rows)), len(rows), width, height)
    header = overlay.header(sheet[0], overlay.letter_size(rows[0][0]) * _LARGER, text)
    image = Image.new("RGB", (sheet[0], sheet[1] + header.height), "white")
    image.paste(header.convert("RGB"), (0, 0))
    for i, row in enumerate(rows):
        for j, snapshot in enumerate(row):
            image.paste(snapshot, (j * (width + _GAP), header.height + i * (height + _GAP)))
    return image


def _size(columns: int, rows: int, width: int, height: int) -> tuple[int, int]:
    """Width and height of all snapshots together, without the header."""
    return columns * (width + _GAP) - _GAP, rows * (height + _GAP) - _GAP
