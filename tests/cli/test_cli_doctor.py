"""``apil doctor`` as a user meets it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from apil_core import __version__
from cli.cli_helpers import COIN, Apil, Outcome


def report(done: Outcome) -> dict[str, dict[str, str]]:
    """The findings by name; checks the document on the way."""
    document = json.loads(done.out)
    assert document.keys() == {"version", "findings", "status"}
    assert document["version"] == __version__
    for finding in document["findings"]:
        assert finding.keys() == {"check", "status", "detail", "remedy"}
        assert finding["status"] in ("ok", "warning", "error")
        assert finding["detail"]
        assert "\n" not in finding["detail"] + finding["remedy"]
    assert done.code == int(document["status"] == "error")
    return {finding["check"]: finding for finding in document["findings"]}


def test_on_this_machine_nothing_keeps_a_run_from_working(apil: Apil, tmp_path: Path) -> None:
    broken = tmp_path / "broken_in_doctor.py"
    broken.write_text("1 / 0\n")
    done = apil("doctor", "--quick", "--json", "--plugin", broken, "--plugin", COIN)
    assert done.err == ""
    found = report(done)
    assert done.code == 0, [finding for finding in found.values() if finding["status"] == "error"]
    assert found["plugin: broken_in_doctor"]["status"] == "warning"
    assert "ZeroDivisionError: division by zero" in found["plugin: broken_in_doctor"]["detail"]
    parts = ("python", "packages", "presets", "cpu", "learner", "gpu", "disk: runs", "disk: victims")
    for part in (*parts, "game: kick-and-defend", "victims: kick-and-defend", "victims: coin"):
        assert part in found
    assert found["disk: runs"]["detail"].startswith(f"{tmp_path / 'runs'}: ")
    # torch's own, if this process has not imported it before the temporary directory was set
    left = [path for path in tmp_path.iterdir() if not path.name.startswith("torchinductor_")]
    assert left == [broken]


@pytest.mark.slow
def test_a_place_where_no_run_can_be_written_is_an_error(apil: Apil) -> None:
    os.chdir("/proc")  # the fixture goes back; not even root may write there
    done = apil("doctor", "--quick")
    assert done.code == 1
    (line,) = [line for line in done.out.splitlines() if " disk: runs " in line]
    assert line.split()[0] == "error"
    assert "/proc/runs cannot be written" in line
    assert "or give --out" in line
    assert done.out.splitlines()[-1].startswith(f"apil {__version__}: ok ")
    assert done.err == ""


@pytest.mark.slow
def test_everything_is_looked_at(apil: Apil) -> None:
    found = report(apil("doctor", "--json"))
    rates = [name for name in found if name.startswith("game: ")]
    assert len(rates) >= 7
    assert all("steps/s" in found[name]["detail"] for name in rates)
    assert {"drawing: egl", "drawing: osmesa", "drawing: glfw"} <= found.keys()
