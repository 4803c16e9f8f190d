"""How charts look: those of learning curves, and those of speed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apil_core.common.errors import ConfigError
from apil_core.common.extras import need

GREY = "#60666f"

STYLE: dict[str, Any] = {
    "text.parse_math": False,  # a dollar in a path is a dollar
    "svg.fonttype": "none",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "grid.color": "#e4e6ea",
    "legend.frameon": False,
}
"""matplotlib's settings, over its defaults."""


FORMATS = (".png", ".svg", ".pdf")
"""What pictures of curves can be written as."""


def check_picture(path: Path) -> None:
    """Whether a picture of curves can be drawn and written under that name.

    Raises:
        ApilError: it cannot, or matplotlib is missing.
    """
    need("matplotlib")
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(f"{path}: curves are drawn as {', '.join(FORMATS[:-1])} or {FORMATS[-1]} files")
