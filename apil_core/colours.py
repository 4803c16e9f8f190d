"""Who is who in pictures: colours go by role, whichever the seat."""

from __future__ import annotations

from apil_core.game import Colour

VICTIM: Colour = (38, 88, 204)
ADVERSARY: Colour = (205, 45, 42)
NEUTRAL: Colour = (96, 102, 112)


def by_side(adversary_side: int) -> tuple[Colour, Colour]:
    """Colours of side 0 and 1."""
    return (ADVERSARY, VICTIM) if adversary_side == 0 else (VICTIM, ADVERSARY)


def light(colour: Colour) -> Colour:
    """A light shade of it, legible on a dark ground."""
    red, green, blue = ((channel + 2 * 255) // 3 for channel in colour)
    return red, green, blue
