"""APL's options."""

from __future__ import annotations

from apil_core import Section


class AplConfig(Section):
    """How the victim's reward enters."""

    advantage_difference: bool = False
    """Instead of the reward term −r^ν: a second critic for r^ν and Â_α − Â_ν, each normalised on its own."""
