"""Toy-pursuit: a chase in a disc, small enough to learn in a minute; an example of a whole game in one file.

The evader (side 0, the victim) runs for a gate on the right; the pursuer (side 1) has to catch it first,
±1000. A quick catch earns the pursuer 500 more, and time up is a tie that costs both 1000: the game is not
zero-sum, so Δr differs from r^α.
"""

from __future__ import annotations

import json
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from apil_core import NO_WINNER, ApilError, Colour, Game, GameLayout, GameStep, Section, SideLayout
from apil_envs.arrays import Array

EVADER, PURSUER = 0, 1
CAUSES = ("caught", "escaped", "time-up")
CAUGHT, ESCAPED, TIME_UP = range(3)
PRIZE, BONUS = 1000.0, 500.0
QUICK = 20
"""A catch within so many steps earns the bonus."""
SPEED = np.array([[0.045], [0.042]])
"""Displacement of evader and pursuer in one step at full action, disc radii."""
CATCH_RADIUS = 0.1
GATE = np.array([0.95, 0.0])
GATE_RADIUS = 0.15
START = np.array([[-0.7, 0.0], [0.1, 0.0]])
START_SPREAD = np.array([[0.1, 0.5], [0.3, 0.4]])
BLOCKS = {
    "position": slice(0, 2),
    "opponent_position": slice(2, 4),
    "gate": slice(4, 6),
    "time_left": slice(6, 7),
}
SIZE = 7


class ToyPursuitOptions(Section):
    """Options of toy-pursuit."""

    max_steps: Annotated[int, Field(gt=0)] = 50
    """Steps after which the game is a tie."""


class ToyPursuit(Game):
    """``num_envs`` chases. Observations, 7 numbers: own position 2, opponent minus own 2, gate minus own 2,
    share of time left 1. Actions: velocity, 2 numbers in ±1."""

    def __init__(self, num_envs: int, threads: int = 1, options: ToyPursuitOptions | None = None):
        options = options or ToyPursuitOptions()
        self.num_envs = num_envs
        sides = (_side("evader"), _side("pursuer"))
        self.layout = GameLayout(sides, options.max_steps, CAUSES)
        self._position = np.zeros((2, num_envs, 2))
        self._clock = np.zeros(num_envs, np.int32)
        self._over = np.ones(num_envs, bool)
        self._buffers = np.zeros((2, 2, num_envs, SIZE), np.float32)
        self._turn = 0
        self._rng = np.random.default_rng(0)

    def seed(self, seed: int) -> None:
        """See :class:`apil_core.Game`."""
        self._rng = np.random.default_rng(seed)

    def reset(self, mask: Array | None = None) -> None:
        """Place the evader on the left and the pursuer near the middle, both at random."""
        rows = np.arange(self.num_envs) if mask is None else np.flatnonzero(mask)
        offset = self._rng.uniform(-1, 1, (2, len(rows), 2))
        self._position[:, rows] = START[:, None] + START_SPREAD[:, None] * offset
        self._clock[rows] = 0
        self._over[rows] = False
        self._observe(rows, self._buffers[self._turn])

    @property
    def observations(self) -> tuple[Array, Array]:
        """See :class:`apil_core.Game`."""
        buffer = self._buffers[self._turn]
        return buffer[EVADER], buffer[PURSUER]

    def step(self, actions: tuple[Array, Array], active: Array | None = None) -> GameStep:
        """See :class:`apil_core.Game`.

        Raises:
            ApilError: no game was ever reset.
        """
        playing = ~self._over if active is None else ~self._over & active
        if self._over.all() and not self._clock.any():
            raise ApilError("toy-pursuit: call reset() before the first step()")
        self._move(actions, playing)
        self._clock += playing
        step = self._score(playing)
        self._over |= step.done
        self._turn = 1 - self._turn
        self._observe(slice(None), self._buffers[self._turn])
        return step

    def state_dict(self) -> dict[str, Any]:
        """See :class:`apil_core.Game`."""
        return {
            "position": self._position.copy(),
            "clock": self._clock.copy(),
            "over": self._over.copy(),
            "observations": self._buffers[self._turn].copy(),
            "random": json.dumps(self._rng.bit_generator.state),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`apil_core.Game`."""
        self._position[...] = state["position"]
        self._clock[...] = state["clock"]
        self._over[...] = state["over"]
        self._buffers[self._turn] = state["observations"]
        self._rng.bit_generator.state = json.loads(state["random"])

    def render(self, row: int, width: int, height: int, colours: tuple[Colour, Colour]) -> Array:
        """See :class:`apil_core.Game`; the dark spot is the gate, the ring around the pursuer its reach."""
        from PIL import Image, ImageDraw

        picture = Image.new("RGB", (2 * width, 2 * height), "white")  # halved below, for smooth edges
        draw, middle = ImageDraw.Draw(picture), np.array([width, height])
        scale = 0.85 * min(width, height)  # pixels per radius of the disc

        def disc(centre: Array, radius: float, **style: Any) -> None:
            x, y = middle + scale * centre * [1, -1]
            draw.ellipse(
                (x - scale * radius, y - scale * radius, x + scale * radius, y + scale * radius), **style
            )

        disc(np.zeros(2), 1.0, fill=(226, 232, 226), outline=(120, 130, 130), width=4)
        disc(GATE, GATE_RADIUS, fill=(150, 160, 155))
        evader, pursuer = self._position[:, row]
        disc(pursuer, CATCH_RADIUS, outline=colours[PURSUER], width=3)
        disc(evader, 0.04, fill=colours[EVADER])
        disc(pursuer, 0.04, fill=colours[PURSUER])
        return np.asarray(picture.resize((width, height), Image.Resampling.BOX))

    def _move(self, actions: tuple[Array, Array], playing: Array) -> None:
        way = np.clip(np.stack(actions), -1, 1) * SPEED[:, None]
        self._position += way * playing[:, None]
        radius = np.sqrt(np.square(self._position).sum(2, keepdims=True))
        self._position /= np.maximum(radius, 1)  # the wall stops players

    def _score(self, playing: Array) -> GameStep:
        evader, pursuer = self._position
        distance = np.sqrt(np.square(pursuer - evader).sum(1))
        caught = playing & (distance < CATCH_RADIUS)
        escaped = playing & ~caught & (np.square(evader - GATE).sum(1) < GATE_RADIUS**2)
        late = playing & ~caught & ~escaped & (self._clock >= self.layout.max_steps)
        sparse = PRIZE * np.stack([escaped * 1.0 - caught - late, caught * 1.0 - escaped - late])
        sparse[PURSUER] += BONUS * (caught & (self._clock <= QUICK))
        dense = np.stack([distance, -distance]) * playing
        return GameStep(
            sparse=sparse.astype(np.float32),
            dense=dense.astype(np.float32),
            shaping=dense.astype(np.float32),
            done=caught | escaped | late,
            winner=np.select([caught, escaped], [PURSUER, EVADER], NO_WINNER).astype(np.int8),
            cause=np.select([caught, escaped, late], [CAUGHT, ESCAPED, TIME_UP], -1).astype(np.int8),
            lengths=self._clock.copy(),
        )

    def _observe(self, rows: Any, buffer: Array) -> None:
        own = self._position[:, rows]
        buffer[:, rows, 0:2] = own
        buffer[:, rows, 2:4] = own[::-1] - own
        buffer[:, rows, 4:6] = GATE - own
        buffer[:, rows, 6] = 1 - self._clock[rows] / self.layout.max_steps


def _side(name: str) -> SideLayout:
    return SideLayout(name, SIZE, 2, -1.0, 1.0, dict(BLOCKS), tuple(range(2, 4)))
