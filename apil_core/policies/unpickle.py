"""Read one vector of floats from a pickle that nobody trusts.

Unpickling runs what the file names, so two fences stand around it. The stream may only hold the few
opcodes an array needs (no lists, dicts, extension codes or large buffers), and each global it names
resolves to an inert stand-in of ours: not even numpy's own constructors see hostile arguments.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apil_core.common.errors import VictimError

MAX_BYTES = 1 << 26
"""Largest pickle that is looked at; the zoo's largest has 1.5 MB."""

_OPCODES = frozenset(
    (
        *("PROTO", "FRAME", "STOP", "GLOBAL", "STACK_GLOBAL", "REDUCE", "BUILD", "BINPUT", "MEMOIZE"),
        *("BINGET", "NONE", "NEWTRUE", "NEWFALSE", "MARK", "TUPLE", "EMPTY_TUPLE", "TUPLE1", "TUPLE2"),
        *("TUPLE3", "BININT", "BININT1", "BININT2", "BINUNICODE", "SHORT_BINUNICODE", "BINBYTES"),
        "SHORT_BINBYTES",
    )
)
_FLOATS = frozenset({"f4", "f8", "<f4", "<f8", "float32", "float64"})


class _RefusedError(Exception):
    """Something a plain array of floats does not need; the message names it."""


class _ArrayType:
    """Stands in for ``numpy.ndarray`` as an argument; cannot be made or changed."""

    def __init__(self, *_: object) -> None:
        raise _RefusedError("numpy.ndarray called directly")

    def __setstate__(self, state: object) -> None:
        raise _RefusedError("state set on numpy.ndarray")


class _Dtype:
    """Stands in for ``numpy.dtype``; admits little-endian float32 and float64 only."""

    def __init__(self, code: object, *_: object) -> None:
        if not (isinstance(code, str) and code in _FLOATS):
            raise _RefusedError(f"dtype {code!r}")
        self.numpy = np.dtype(code).newbyteorder("<")

    def __setstate__(self, state: object) -> None:
        if not (isinstance(state, tuple) and len(state) >= 2 and state[1] in ("<", "=")):
            raise _RefusedError(f"dtype state {state!r:.60}")


class _Array:
    """Stands in for numpy's ``_reconstruct``: takes an array's state, makes the array from raw bytes."""

    value: NDArray[Any] | None = None

    def __init__(self, kind: object = None, *_: object) -> None:
        if kind is not _ArrayType:
            raise _RefusedError(f"array of type {kind!r:.60}")

    def __setstate__(self, state: object) -> None:
        match state:
            case (int(), tuple() as shape, _Dtype() as dtype, bool(), bytes() as raw):
                self.value = _from_bytes(raw, shape, dtype.numpy)
            case (_, _, _Dtype(), _, content):
                raise _RefusedError(f"array content of type {type(content).__name__}")
            case _:
                raise _RefusedError("malformed array state")


_STAND_INS: dict[tuple[str, str], type] = {
    ("numpy", "ndarray"): _ArrayType,
    ("numpy", "dtype"): _Dtype,
    ("numpy.core.multiarray", "_reconstruct"): _Array,  # before numpy 2
    ("numpy._core.multiarray", "_reconstruct"): _Array,
}


class _ArrayUnpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str) -> type:
        try:
            return _STAND_INS[module_name, global_name]
        except KeyError:
            raise _RefusedError(f"global {module_name}.{global_name}") from None


def read_vector(data: bytes, source: str, length: int | None = None) -> NDArray[np.float32]:
    """The one-dimensional float array pickled in ``data``.

    Args:
        data: the whole pickle, protocol 3 or 4.
        source: what to call it in errors.
        length: number of values it must have, if known.

    Returns:
        shape (length,), float32 (float64 is rounded), finite, read-only.

    Raises:
        VictimError: the pickle holds anything else; one line that names what was refused.
    """
    if len(data) > MAX_BYTES:
        raise VictimError(f"{source}: {len(data)} bytes are too many for zoo weights (limit {MAX_BYTES})")
    try:
        _check_opcodes(data)
        content = _ArrayUnpickler(io.BytesIO(data), fix_imports=False).load()
        return _checked(content, length)
    except _RefusedError as error:
        raise VictimError(f"{source}: refused: {error}; only a plain array of floats is read") from None
    except Exception as error:  # pickle raises nearly every kind on damaged data
        reason = " ".join(str(error).split())
        raise VictimError(
            f"{source}: not a readable pickle ({type(error).__name__}: {reason:.100})"
        ) from error


def _check_opcodes(data: bytes) -> None:
    for opcode, _, position in pickletools.genops(data):
        if opcode.name not in _OPCODES:
            raise _RefusedError(f"pickle opcode {opcode.name} at byte {position}")


def _from_bytes(raw: bytes, shape: tuple[object, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    sizes = [size for size in shape if type(size) is int and size >= 0]
    if len(sizes) != len(shape) or prod(sizes) * dtype.itemsize != len(raw):
        raise _RefusedError(f"array shape {shape!r:.60} with {len(raw)} bytes of {dtype.name}")
    return np.frombuffer(raw, dtype).reshape(sizes)


def _checked(content: object, length: int | None) -> NDArray[np.float32]:
    if not isinstance(content, _Array) or content.value is None:
        raise _RefusedError(f"a {type(content).__name__.lstrip('_').lower()} instead of an array")
    array = content.value
    if array.ndim != 1 or (length is not None and len(array) != length):
        expected = "one axis" if length is None else f"({length},)"
        raise _RefusedError(f"array of shape {array.shape} where {expected} is expected")
    with np.errstate(over="ignore"):  # a double too large for float32 turns into inf, refused below
        vector = array.astype(np.float32, copy=False)
    if not np.isfinite(vector).all():
        raise _RefusedError("values that are not finite")
    return vector
