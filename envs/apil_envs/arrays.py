"""The array type of this package."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

Rows = slice | NDArray[np.intp]
"""Selection of games: ``slice(None)`` for all (gives views), or indices (gives copies)."""

ALL = slice(None)
