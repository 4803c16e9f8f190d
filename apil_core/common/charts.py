"""How charts look: those of learning curves, and those of speed."""

from __future__ import annotations

from typing import Any

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
