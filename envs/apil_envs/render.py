"""Pictures of a MuJoCo game, rendered from a copy of its state: drawing never changes the simulations."""

from __future__ import annotations

import mujoco
import numpy as np

from apil_core import ApilError, Colour
from apil_envs import gl
from apil_envs.arrays import Array
from apil_envs.looks import GOAL
from apil_envs.physics import Physics

RING = "arena"
"""Name of the geom that is always entirely in view, if a scene has it."""

LARGEST = 4096
"""Pixels a picture may be wide or high."""

_AZIMUTH, _ELEVATION = 90.0, np.radians(-22.0)  # from the side, x to the right, a little from above
_RIGHT = np.array([1.0, 0.0, 0.0])
_FORWARD = np.array([0.0, np.cos(_ELEVATION), np.sin(_ELEVATION)])
_UP = np.array([0.0, -np.sin(_ELEVATION), np.cos(_ELEVATION)])
_EYES = 0.8  # least height of the camera's target, m
_NEAREST = 2.9  # half width of what is always in view, m
_FIELD = np.array([[-5.0, -4.5, 0.0], [5.0, 4.5, 2.6]])  # objects that leave it are not followed, m
_BESIDE, _ABOVE, _EDGE = 1.1, 1.1, 0.3  # margin around players and ball, and around ring and goal, m
_LIT = 10.0  # half width of the square in which things cast shadows, m
_SHADOW_PIXELS = 2048


class Scenery:
    """A game's model and state, copied for drawing.

    Args:
        physics: the simulations.
        row: index of the simulation.
        colours: of side 0 and 1.

    Attributes:
        model, data: the copies.
        camera: keeps both players, the ball, the ring and the goal in view.
    """

    def __init__(self, physics: Physics, row: int, colours: tuple[Colour, Colour]):
        self._physics = physics
        self.model = model = physics.row_model(row)
        self.data = mujoco.MjData(model)
        self.camera = mujoco.MjvCamera()
        self.camera.azimuth, self.camera.elevation = _AZIMUTH, np.degrees(_ELEVATION)
        roots = model.body_rootid[model.geom_bodyid]
        self._parts = [roots == model.body(f"agent{side}/torso").id for side in (0, 1)]
        self._movers = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        self._ring = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, RING)
        self._goal = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, GOAL)
        self.update(row, colours)

    def update(self, row: int, colours: tuple[Colour, Colour]) -> None:
        """Copy a game's current positions and the size of its ring."""
        self._physics.row_model(row, self.model)
        for parts, colour in zip(self._parts, colours, strict=True):
            self.model.geom_rgba[parts] = [*(channel / 255 for channel in colour), 1.0]
        self.data.qpos[:] = self._physics.qpos[row]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def aim(self, aspect: float) -> None:
        """Point the camera for pictures of that width per height."""
        points, room = self._in_view()
        centre = (points.min(0) + points.max(0)) / 2
        centre[2] = max(centre[2], _EYES)
        offsets = points - centre
        slope = np.tan(np.radians(self.model.vis.global_.fovy / 2))
        across = (np.abs(offsets @ _RIGHT) + room[:, 0]) / (slope * aspect)
        upright = (np.abs(offsets @ _UP) + room[:, 1]) / slope
        enough = np.maximum(across, upright) - offsets @ _FORWARD  # distant objects appear smaller
        self.camera.lookat[:] = centre
        self.camera.distance = max(_NEAREST / (slope * aspect), enough.max())

    def _in_view(self) -> tuple[Array, Array]:
        """Points that must be in view, (k, 3), and the margin beside and above each, (k, 2), m."""
        points = np.clip(self.data.xpos[self._movers], *_FIELD)
        room = np.full((len(points), 2), (_BESIDE, _ABOVE))
        places = self._ring_edge()
        if self._goal >= 0:
            places = np.vstack([places, self.model.site_pos[self._goal] * [1, 1, 0]])
        return np.vstack([points, places]), np.vstack([room, np.full((len(places), 2), _EDGE)])

    def _ring_edge(self) -> Array:
        """Eight points on the edge of the ring's top, or none without a ring, (k, 3)."""
        if self._ring < 0:
            return np.zeros((0, 3))
        radius, half_height = self.model.geom_size[self._ring, :2]
        angles = np.arange(8) * np.pi / 4
        edge = np.stack([np.cos(angles), np.sin(angles), np.zeros(8)], 1)
        return self.model.geom_pos[self._ring] + radius * edge + [0, 0, half_height]


class Painter:
    """Renders one scene at one size.

    Raises:
        ApilError: no OpenGL works here, or the size is out of bounds.
    """

    def __init__(self, scenery: Scenery, width: int, height: int):
        if not (0 < width <= LARGEST and 0 < height <= LARGEST):
            raise ApilError(f"a picture has 1 to {LARGEST} pixels a side, not {width} × {height}")
        gl.prepare()
        visual = scenery.model.vis
        visual.global_.offwidth, visual.global_.offheight = width, height
        visual.quality.shadowsize = _SHADOW_PIXELS
        visual.map.shadowclip = _LIT / scenery.model.stat.extent
        self._scenery = scenery
        self._renderer = mujoco.Renderer(scenery.model, height, width)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = True

    def paint(self) -> Array:
        """Picture of the scene, (height, width, 3) uint8."""
        self._scenery.aim(self._renderer.width / self._renderer.height)
        self._renderer.update_scene(self._scenery.data, self._scenery.camera)
        return self._renderer.render()

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()


class Studio:
    """Cache of objects that are costly to create: one scene, and a renderer for each size requested."""

    def __init__(self, physics: Physics):
        self._physics = physics
        self._scenery: Scenery | None = None
        self._painters: dict[tuple[int, int], Painter] = {}

    def paint(self, row: int, width: int, height: int, colours: tuple[Colour, Colour]) -> Array:
        """See :meth:`apil_core.Game.render`."""
        if self._scenery is None:
            self._scenery = Scenery(self._physics, row, colours)
        if (width, height) not in self._painters:
            self._painters[width, height] = Painter(self._scenery, width, height)
        self._scenery.update(row, colours)
        return self._painters[width, height].paint()

    def close(self) -> None:
        """Release all OpenGL contexts."""
        while self._painters:
            self._painters.popitem()[1].close()
