"""Reasons of other people's code, on one line."""

from __future__ import annotations

from apil_core.common.errors import reason_of


def test_a_long_reason_keeps_its_end() -> None:
    lines = ["The following operation failed in the TorchScript interpreter.", *["  File x, line 1"] * 50]
    shown = reason_of(
        RuntimeError("\n".join([*lines, "RuntimeError: shapes cannot be multiplied (8x3 and 4x2)"]))
    )
    assert shown.startswith("RuntimeError: The following operation failed in the TorchScript interpreter.")
    assert shown.endswith(" RuntimeError: shapes cannot be multiplied (8x3 and 4x2)")
    assert len(shown) == len("RuntimeError: ") + 303


def test_a_short_one_is_whole() -> None:
    assert reason_of(ValueError("a\n  b")) == "ValueError: a b"
    assert reason_of(ValueError()) == "ValueError"
