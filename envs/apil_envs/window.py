"""MuJoCo's viewer as the window of a game."""

from __future__ import annotations

import mujoco
import mujoco.viewer

from apil_core import ApilError, Colour, Window
from apil_envs import gl
from apil_envs.physics import Physics
from apil_envs.render import Scenery

_ASPECT = 4 / 3  # of the first view; the window's aspect ratio is unknown


class ViewerWindow(Window):
    """One game in MuJoCo's viewer, in which the user can move the camera.

    Args:
        physics: the simulations.
        row: which of them.
        colours: of side 0 and 1.

    Raises:
        ApilError: there is no screen, or the viewer cannot use it.
    """

    def __init__(self, physics: Physics, row: int, colours: tuple[Colour, Colour]):
        # without a screen the viewer would deadlock
        if not gl.has_screen() or not gl.works("glfw"):
            raise ApilError("there is no screen to open a window on")
        self._row, self._colours = row, colours
        self._scenery = Scenery(physics, row, colours)
        try:
            self._viewer = mujoco.viewer.launch_passive(
                self._scenery.model, self._scenery.data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # macOS requires another interpreter; the error names it
            raise ApilError(f"cannot open a window: {' '.join(str(error).split())}") from error
        self._scenery.aim(_ASPECT)
        with self._viewer.lock():
            for name in ("lookat", "distance", "azimuth", "elevation"):
                setattr(self._viewer.cam, name, getattr(self._scenery.camera, name))

    @property
    def is_open(self) -> bool:
        """See :class:`apil_core.Window`."""
        return bool(self._viewer.is_running())

    def show(self, caption: str) -> None:
        """See :class:`apil_core.Window`."""
        with self._viewer.lock():
            self._scenery.update(self._row, self._colours)
        self._viewer.set_texts((None, mujoco.mjtGridPos.mjGRID_TOPLEFT, caption, ""))
        self._viewer.sync()

    def close(self) -> None:
        """See :class:`apil_core.Window`."""
        self._viewer.close()
