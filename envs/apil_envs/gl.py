"""MuJoCo's OpenGL backend on this machine: GLFW with a display, EGL or OSMesa without one."""

from __future__ import annotations

import functools
import importlib
import os
import subprocess
import sys
from tempfile import TemporaryDirectory
from typing import Any

from apil_core import ApilError

BACKENDS = {"glfw": "a screen", "egl": "EGL", "osmesa": "OSMesa"}
"""Values of ``MUJOCO_GL`` on Linux, and what each draws through."""

_ADVICE = "install one: `apt-get install libegl1` or `apt-get install libosmesa6`"
_BLOCKING = (
    *("PYOPENGL_PLATFORM", "EGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID", "EGL_DEVICE_ID"),
    *("__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS", "LIBGL_DRIVERS_PATH", "GALLIUM_DRIVER"),
)
"""Variables that can prevent the use of an installed OpenGL."""
_TRIAL = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco/>")
data = mujoco.MjData(model)
renderer = mujoco.Renderer(model, 8, 8)
renderer.update_scene(data)
renderer.render()
renderer.close()
"""
_PATIENCE = 60.0  # s; a trial takes about 1 s


def has_screen() -> bool:
    """True if the environment names a display to open windows on."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def wanted() -> tuple[str, ...]:
    """Backends to try, in order: the user's ``MUJOCO_GL`` alone, or all that may work here."""
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in BACKENDS:
        return (asked,)
    return ("glfw", "egl", "osmesa") if has_screen() else ("egl", "osmesa")


def prepare() -> None:
    """Make :class:`mujoco.Renderer` use a backend that works here; called before the first renderer.

    Raises:
        ApilError: none works; states the backends tried and what to install.
    """
    if sys.platform != "linux":
        return  # MuJoCo's default works here
    backend = _first_working(wanted())
    # MuJoCo binds the backend when it is first imported, long before the first picture
    holder: Any = importlib.import_module("mujoco.rendering.classic.gl_context")
    holder.GLContext = importlib.import_module(f"mujoco.{backend}").GLContext


@functools.cache
def _first_working(backends: tuple[str, ...]) -> str:
    for backend in backends:
        if works(backend):
            return backend
    for name in (name for name in _BLOCKING if name in os.environ):
        if any(works(backend, without=name) for backend in backends):
            raise ApilError(f"cannot draw: {name}={os.environ[name]} keeps OpenGL from working; unset it")
    tried = ", ".join(BACKENDS[backend] for backend in backends)
    only = f" (MUJOCO_GL={backends[0]})" if len(backends) == 1 else ""
    raise ApilError(f"cannot draw: no OpenGL here, tried {tried}{only}; {_ADVICE}")


def works(backend: str, without: str = "") -> bool:
    """Try to render with that backend in a separate process, optionally without a variable.

    The libraries of two backends in one process conflict, and a broken driver may crash it.
    """
    environment = {name: value for name, value in os.environ.items() if name != without}
    command = [sys.executable, "-P", "-c", _TRIAL]
    how: Any = {"env": {**environment, "MUJOCO_GL": backend}, "capture_output": True, "timeout": _PATIENCE}
    with TemporaryDirectory() as folder:  # MuJoCo writes its log there on failure
        try:
            return subprocess.run(command, cwd=folder, check=False, **how).returncode == 0
        except subprocess.TimeoutExpired:
            return False
