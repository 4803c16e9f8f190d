"""What ``apil doctor`` says of drawing is what the games find out when they draw."""

from __future__ import annotations

import pytest

from apil_core.cli.doctor_checks import Scope, offers
from apil_core.plugins.discovery import discover
from apil_envs import gl


@pytest.mark.slow
def test_a_backend_works_for_the_doctor_where_it_works_for_the_games(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    findings = {finding.check: finding for finding in offers.drawing(Scope(discover()))}
    assert findings.keys() == {f"drawing: {backend}" for backend in gl.BACKENDS}
    working = {backend for backend in gl.BACKENDS if gl.works(backend)}
    for backend in gl.BACKENDS:
        finding = findings[f"drawing: {backend}"]
        assert ("draws kick-and-defend" in finding.detail) == (backend in working)
        assert finding.status == ("ok" if working else "warning")
    if not working:
        assert "libegl1" in findings["drawing: egl"].remedy
        assert "libosmesa6" in findings["drawing: osmesa"].remedy


@pytest.mark.slow
def test_an_opengl_that_is_asked_for_but_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    if gl.works("osmesa"):
        pytest.skip("OSMesa is installed")
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    (finding,) = offers.games(Scope(discover(), quick=True))
    assert finding.status == "error"
    assert finding.remedy == "unset MUJOCO_GL, or `apt-get install libosmesa6`"
    if gl.works("egl"):
        asked = {finding.check: finding for finding in offers.drawing(Scope(discover()))}[
            "drawing: MUJOCO_GL"
        ]
        assert asked.status == "warning"
        assert "asks for osmesa" in asked.detail


def test_quick_draws_nothing() -> None:
    assert list(offers.drawing(Scope(discover(), quick=True))) == []
