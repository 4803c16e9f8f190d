"""The two markers plugins use, and the name they share."""

from __future__ import annotations

import pluggy

PROJECT = "apil"

hookspec = pluggy.HookspecMarker(PROJECT)
"""Marks a function as a hook that others may fill (for plugins that open hooks of their own)."""

hookimpl = pluggy.HookimplMarker(PROJECT)
"""Marks a function or method as filling a hook."""
