"""Whether tests can draw with MuJoCo here."""

from __future__ import annotations

import pytest

from apil_core import ApilError
from apil_envs import gl


def need_opengl() -> None:
    """Skip the test where no OpenGL works."""
    try:
        gl.prepare()
    except ApilError as error:
        pytest.skip(str(error))
