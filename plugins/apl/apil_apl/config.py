"""APL's options."""

from __future__ import annotations

from apil_core import Section


class AplConfig(Section):
    """Use of the victim's reward."""

    advantage_difference: bool = False
    """Instead of the reward term −r^ν: a second critic for r^ν and Â_α − Â_ν, each normalised separately."""
