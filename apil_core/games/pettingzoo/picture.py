"""Conversion of an environment's ``render()`` to a picture of a given size."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image, ImageOps

from apil_core.api.game import Array
from apil_core.common.errors import ApilError


def fitted(frame: Any, width: int, height: int) -> Array:
    """Scale ``frame``, (any height, any width, 3 or 4) uint8, with bars where its aspect ratio differs.

    Returns:
        (height, width, 3) uint8.

    Raises:
        ApilError: it is no picture.
    """
    if isinstance(frame, str):
        raise ApilError(f"its render() failed: {frame}")
    if frame is None:
        raise ApilError("its render() gives no picture; try --set game.kwargs.render_mode=rgb_array")
    pixels = np.asarray(frame)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise ApilError(f"its render() gives {pixels.dtype} of shape {pixels.shape}, not a picture")
    return np.asarray(ImageOps.pad(Image.fromarray(pixels[..., :3]), (width, height)))
