"""Colours of adversary and victim in pictures, by role, not by seat."""

from __future__ import annotations

Colour = tuple[int, int, int]
"""Red, green and blue, 0–255."""


VICTIM: Colour = (38, 88, 204)
ADVERSARY: Colour = (205, 45, 42)
NEUTRAL: Colour = (96, 102, 112)

LINES: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (0, 0, 0),
)
"""Line colours: Okabe and Ito's palette, distinguishable with colour blindness."""


def by_side(adversary_side: int) -> tuple[Colour, Colour]:
    """Colours of side 0 and 1."""
    return (ADVERSARY, VICTIM) if adversary_side == 0 else (VICTIM, ADVERSARY)


def light(colour: Colour) -> Colour:
    """A light shade of it, legible on a dark ground."""
    red, green, blue = ((channel + 2 * 255) // 3 for channel in colour)
    return red, green, blue
