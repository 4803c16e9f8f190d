"""Pickles of published agents: arrays and plain values are read, nothing in them is run."""

from __future__ import annotations

import pickle
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from apil_core import Opaque, VictimError, read_pickle
from policies.foreign_files import malicious

# Python 2: an object of another library with one array; the array's bytes are text
PYTHON_2 = (
    b"ccopy_reg\n_reconstructor\n(crunning_mean_std\nRunningMeanStd\nc__builtin__\nobject\nNtR(dS'mean'\n"
    b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR"
    b"(I1\n(I2\ntcnumpy\ndtype\n(S'f4'\nI0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI0\ntb"
    b"I00\nS'\\x00\\x00\\x80?\\x00\\x00\\x20\\xc0'\ntbsb."
)


class Settings:
    """Of a library that is not installed where the file is read."""

    def __init__(self, value: Any):
        self.value = value


def written(path: Path, value: Any, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(value, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", range(6))
def test_arrays_and_plain_values_are_read(tmp_path: Path, protocol: int) -> None:
    value = {
        "kernel": np.arange(6, dtype=">f4").reshape(2, 3),
        "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "count": np.float64(2.5),
        "rest": [1, "a", (None, True), OrderedDict(x=b"y")],
    }
    found = read_pickle(written(tmp_path / "f.pkl", value, protocol))
    assert found["kernel"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert found["columns"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert found["count"] == 2.5
    assert found["rest"][:3] == [1, "a", (None, True)]
    assert list(found["rest"][3]) == ["x"]


@pytest.mark.parametrize("protocol", range(6))
def test_objects_of_other_libraries_are_opaque(tmp_path: Path, protocol: int) -> None:
    found = read_pickle(written(tmp_path / "f.pkl", (Settings(np.ones(2)), Settings), protocol))
    assert isinstance(found[0], Opaque)
    assert found[1].type == f"{__name__}.Settings"
    assert found[0].state["value"].tolist() == [1, 1]


def test_a_file_of_python_2(tmp_path: Path) -> None:
    (tmp_path / "f.pkl").write_bytes(PYTHON_2)
    assert read_pickle(tmp_path / "f.pkl").state["mean"].tolist() == [1.0, -2.5]


def test_nothing_is_run(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    (tmp_path / "f.pkl").write_bytes(malicious(mark))
    assert isinstance(read_pickle(tmp_path / "f.pkl"), Opaque)
    assert not mark.exists()


def test_a_pickle_does_not_change_the_reader(tmp_path: Path) -> None:
    # BUILD on the classes that stand for numpy's: sets attributes of a class that has no __setstate__
    names = (
        b"numpy\ndtype",
        b"numpy\nndarray",
        b"numpy.core.multiarray\nscalar",
        b"numpy.core.numeric\n_frombuffer",
    )
    for name in (*names, b"collections\nOrderedDict", b"_codecs\nencode", b"copyreg\n_reconstructor"):
        (tmp_path / "f.pkl").write_bytes(b"c" + name + b"\n(N(dS'__new__'\nNstb.")
        with pytest.raises(VictimError, match=r"f\.pkl: not a readable pickle: "):
            read_pickle(tmp_path / "f.pkl")
    assert read_pickle(written(tmp_path / "g.pkl", np.arange(3))).tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (pickle.dumps(np.array([{}], dtype=object)), "UnpicklingError: an array of 'O8', not of numbers"),
        (pickle.dumps(np.ones(3))[:-20], "UnpicklingError: pickle data was truncated"),
        (
            pickle.dumps(np.ones(3), 2).replace(b"K\x03\x85", b"K\x04\x85"),
            "UnpicklingError: an array (4,) of 24 bytes",
        ),
        (b"no pickle", "UnpicklingError: "),
    ],
)
def test_what_is_not_read_is_one_line(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "f.pkl").write_bytes(content)
    with pytest.raises(VictimError) as caught:
        read_pickle(tmp_path / "f.pkl")
    assert str(caught.value).startswith(f"{tmp_path / 'f.pkl'}: not a readable pickle: {reason}")


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(VictimError, match=r"none\.pkl: cannot be read \(No such file or directory\)"):
        read_pickle(tmp_path / "none.pkl")
