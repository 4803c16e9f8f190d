"""Parsing of number shorthands: ``300k`` steps, seeds ``0..4``."""

from __future__ import annotations

from contextlib import suppress


def whole_number(text: str) -> int:
    """A whole number, also written 300k, 35M, 1e6 or 1_000_000.

    Raises:
        ValueError: it is none.
    """
    factor = {"k": 10**3, "m": 10**6}.get(text[-1:].lower(), 1)
    digits = text[:-1] if factor > 1 else text
    with suppress(ValueError):
        return int(digits) * factor  # exact, also above 2⁵³
    with suppress(ValueError):
        if (value := float(digits) * factor).is_integer():  # NaN and infinity are not
            return int(value)
    raise ValueError(f"{text!r} is not a whole number")


def short_number(value: int) -> str:
    """The number in short form for names: ``1M``, ``1500k``, ``12345``; lossless."""
    for size, letter in ((10**6, "M"), (10**3, "k")):
        if value and value % size == 0:
            return f"{value // size}{letter}"
    return str(value)


def number_list(text: str) -> list[int]:
    """``0..4`` (both ends included), ``0,3,7``, or both.

    Raises:
        ValueError: it names none, or one twice.
    """
    numbers: list[int] = []
    for part in text.split(","):
        first, dots, last = part.partition("..")
        numbers += range(int(first), int(last) + 1) if dots else [int(first)]
    if not numbers or len(set(numbers)) < len(numbers):
        raise ValueError(f"{text!r} names no seed, or one twice")
    return numbers
