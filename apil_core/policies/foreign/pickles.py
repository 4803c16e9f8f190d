"""Reading pickles of numpy arrays and plain Python values without running code in them."""

from __future__ import annotations

import io
import pickle
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from apil_core.common.errors import VictimError, reason_of


class Opaque:
    """An object of a pickle whose class or function is neither imported nor called.

    Attributes:
        type: full name of that class or function, e.g. ``"stable_baselines.common.policies.MlpPolicy"``.
        args: it was made with.
        state: it was given: for most classes its attributes by name; ``None`` without.
        items: what was appended to it, or (key, value) pairs set in it.
    """

    type = ""

    def __new__(cls, *args: Any, **_: Any) -> Opaque:
        """Made by the pickle, with the arguments it would call the class or function with."""
        self = super().__new__(cls)
        self.args, self.state, self.items = args, None, []
        return self

    args: tuple[Any, ...]
    state: Any
    items: list[Any]

    def __repr__(self) -> str:
        return f"<{self.type}>"

    def __call__(self, *args: Any) -> Opaque:
        """What this, as a function, would return."""
        made = Opaque(*args)
        made.type = f"{self.type}()"
        return made

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def __setitem__(self, key: Any, value: Any) -> None:
        self.items.append((key, value))

    def append(self, item: Any) -> None:
        """Called for lists in a pickle."""
        self.items.append(item)


# Each has a __setstate__: of a class without one, a pickle could set attributes, for the whole process.
class _DType:
    def __init__(self, name: str, *_: Any):
        self.name, self.order = name, "="

    def __setstate__(self, state: Any) -> None:
        self.order = state[1]

    def checked(self) -> np.dtype[Any]:
        """As numpy's; only numbers."""
        dtype = np.dtype(self.name) if isinstance(self.name, str) else None
        if dtype is None or dtype.kind not in "biufc":
            raise pickle.UnpicklingError(f"an array of {self.name!r:.40}, not of numbers")
        order: Any = self.order
        return dtype.newbyteorder(order)


class _Array(np.ndarray[Any, Any]):
    def __new__(cls, *_: Any) -> _Array:
        return super().__new__(cls, 0)

    def __setstate__(self, state: Any) -> None:
        shape, dtype, fortran, raw = state[-4:]
        dtype, raw = dtype.checked(), raw.encode("latin1") if isinstance(raw, str) else raw  # str: Python 2
        if min(shape, default=0) < 0 or prod(shape) * dtype.itemsize != len(raw):
            raise pickle.UnpicklingError(f"an array {shape} of {len(raw)} bytes")
        checked: Any = (1, shape, dtype, bool(fortran), raw)
        super().__setstate__(checked)


class _FromBuffer:
    def __new__(cls, raw: Any, dtype: _DType, shape: Any, order: str) -> Any:
        return np.frombuffer(raw, dtype.checked()).reshape(shape, order="F" if order == "F" else "C")

    def __setstate__(self, state: Any) -> None: ...


class _Scalar:
    def __new__(cls, dtype: _DType, raw: Any) -> Any:
        return np.frombuffer(raw.encode("latin1") if isinstance(raw, str) else raw, dtype.checked())[0]

    def __setstate__(self, state: Any) -> None: ...


class _Bytes:
    def __new__(cls, text: str, _: str) -> Any:
        return text.encode("latin1")

    def __setstate__(self, state: Any) -> None: ...


class _Made:
    def __new__(cls, kind: type[Opaque], *args: Any) -> Any:
        return kind.__new__(kind, *args) if issubclass(kind, Opaque) else Opaque(kind, *args)

    def __setstate__(self, state: Any) -> None: ...


_KNOWN: dict[str, type] = {
    "collections.OrderedDict": dict,
    "_codecs.encode": _Bytes,  # protocols 0 to 2
    "copyreg._reconstructor": _Made,
    "copy_reg._reconstructor": _Made,
    "numpy.ndarray": _Array,
    "numpy.dtype": _DType,
    **{f"numpy.{core}.multiarray._reconstruct": _Array for core in ("core", "_core")},
    **{f"numpy.{core}.multiarray.scalar": _Scalar for core in ("core", "_core")},
    **{f"numpy.{core}.numeric._frombuffer": _FromBuffer for core in ("core", "_core")},
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        full = f"{module}.{name}"
        return _KNOWN.get(full) or type(name, (Opaque,), {"type": full})

    def persistent_load(self, pid: Any) -> Any:
        return Opaque(pid)


def read_pickle(path: str | Path) -> Any:
    """Read a pickle, e.g. of a published agent; no code in it, and none that it names, is run.

    Arrays and numbers of numpy, and Python's own values and containers, are read as they are; anything else
    is an :class:`Opaque` with its arguments and state. Reads cloudpickle's files and those of Python 2, too.

    Args:
        path: of the file. It is read whole: a hostile one can use much memory.

    Raises:
        VictimError: the file cannot be read, is no pickle or a damaged one, or has arrays of objects.
    """
    try:
        return _Unpickler(io.BytesIO(Path(path).read_bytes()), encoding="latin1").load()
    except OSError as error:
        raise VictimError(f"{path}: cannot be read ({error.strerror})") from error
    except Exception as error:  # any, as the file decides what goes wrong
        raise VictimError(f"{path}: not a readable pickle: {reason_of(error)}") from error
