"""Hostile and damaged pickles: refused with a line that names what was refused, and nothing runs."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from apil_core import VictimError
from apil_core.policies.unpickle import MAX_BYTES, read_vector

VECTOR = np.arange(5, dtype=np.float32)


class Attack:
    """Pickles as a call of ``function``."""

    def __init__(self, function: Any, *arguments: Any):
        self.call = function, arguments

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return self.call


@pytest.mark.parametrize("protocol", [3, 4])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_plain_vectors_are_read(protocol: int, dtype: type) -> None:
    vector = read_vector(pickle.dumps(VECTOR.astype(dtype), protocol), "x", 5)
    np.testing.assert_array_equal(vector, VECTOR)
    assert vector.dtype == np.float32


def test_name_of_old_numpy_is_read() -> None:
    data = pickle.dumps(VECTOR, 3).replace(b"numpy._core.multiarray", b"numpy.core.multiarray")
    assert b"numpy.core.multiarray" in data
    np.testing.assert_array_equal(read_vector(data, "x"), VECTOR)


@pytest.mark.parametrize("protocol", [0, 2, 3, 4, 5])
def test_call_of_the_shell(protocol: int, tmp_path: Path) -> None:
    mark = tmp_path / "owned"
    data = pickle.dumps(Attack(os.system, f"touch {mark}"), protocol)
    with pytest.raises(VictimError, match=r"^bad\.pkl: refused: ") as caught:
        read_vector(data, "bad.pkl")
    if protocol in (3, 4):
        assert "posix.system" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (np.array([Attack(os.getcwd)], dtype=object), "opcode EMPTY_LIST"),
        (np.arange(5), "dtype 'i8'"),
        (np.arange(5, dtype=np.complex64), "dtype 'c8'"),
        (np.arange(5, dtype=np.float16), "dtype 'f2'"),
        (np.zeros(2, dtype=[("a", "f4")]), "opcode EMPTY_DICT"),
        (np.arange(5, dtype=">f4"), r"dtype state \(3, '>'"),
        ([VECTOR, [VECTOR]], "opcode EMPTY_LIST"),
        ({"weights": VECTOR}, "opcode EMPTY_DICT"),
        ((VECTOR, VECTOR), "a tuple instead of an array"),
        (np.dtype("f4"), "a dtype instead of an array"),
        (np.ndarray, "a type instead of an array"),
        (Attack(np.ndarray, (3,)), "numpy.ndarray called directly"),
        (Attack(np.load, "x.npy"), "global numpy.load"),
        (Attack(eval, "1"), "global builtins.eval"),
        (None, "a nonetype instead of an array"),
        ("text", "a str instead of an array"),
        (1.5, "opcode BINFLOAT"),
        (VECTOR.reshape(1, 5), r"shape \(1, 5\)"),
        (VECTOR[:4], r"shape \(4,\) where \(5,\) is expected"),
        (np.array([1, np.nan, 3, 4, 5], np.float32), "not finite"),
        (np.array([1, np.inf, 3, 4, 5], np.float32), "not finite"),
        (np.array([1, 1e300, 3, 4, 5]), "not finite"),
    ],
)
def test_anything_else_is_refused(content: Any, named: str) -> None:
    with pytest.raises(VictimError, match=f"^bad.pkl: refused: .*{named}"):
        read_vector(pickle.dumps(content, 3), "bad.pkl", 5)


def _patched(old: bytes, new: bytes) -> bytes:
    data = pickle.dumps(VECTOR, 3)
    assert data.count(old) == 1
    return data.replace(old, new)


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (pickle.dumps(VECTOR, 3)[:-20], "not a readable pickle"),
        (pickle.dumps(VECTOR, 3)[:30], "not a readable pickle"),
        (b"", "not a readable pickle"),
        (b"\x00" * 50, "not a readable pickle"),
        (b"<!DOCTYPE html>", "not a readable pickle|refused"),
        (bytes(MAX_BYTES + 1), "too many"),
        (_patched(b"K\x05\x85", b"K\x06\x85"), r"array shape \(6,\) with 20 bytes of float32"),
        (_patched(b"f4", b"O8"), "dtype 'O8'"),
        (_patched(b"f4", b"f8"), r"array shape \(5,\) with 20 bytes of float64"),
        (b"\x80\x03r\xff\xff\xff\x7f.", "opcode LONG_BINPUT"),  # would grow the memo to gigabytes
        (b"\x80\x05\x96" + (1 << 40).to_bytes(8, "little") + b".", "not a readable pickle|opcode BYTEARRAY8"),
        (b"\x80\x03cnumpy\ndtype\n}b.", "opcode EMPTY_DICT"),
        (b"\x80\x03cnumpy\ndtype\n)b.", "not a readable pickle"),  # state set on the class itself
        (b"\x80\x03cnumpy._core.multiarray\n_reconstruct\n)b.", "not a readable pickle"),
        (b"\x80\x03cnumpy._core.multiarray\n_reconstruct\n)R.", "array of type None"),
    ],
)
def test_damaged_streams(data: bytes, named: str) -> None:
    with pytest.raises(VictimError, match=named) as caught:
        read_vector(data, "bad.pkl", 5)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_any_single_bit_flip_is_harmless() -> None:
    """Either it is refused as a VictimError, or a vector of floats of the right length comes out."""
    whole = pickle.dumps(VECTOR, 3)
    for position in range(len(whole)):
        for bit in range(8):
            data = bytearray(whole)
            data[position] ^= 1 << bit
            try:
                vector = read_vector(bytes(data), "bad.pkl", 5)
            except VictimError:
                continue
            assert vector.shape == (5,)
            assert vector.dtype == np.float32


@pytest.mark.parametrize("protocol", [3, 4])
def test_long_vectors_are_read(protocol: int) -> None:
    vector = np.linspace(0, 1, 70_000, dtype=np.float32)  # other opcodes than short ones: frames, BINBYTES
    np.testing.assert_array_equal(read_vector(pickle.dumps(vector, protocol), "x", 70_000), vector)
