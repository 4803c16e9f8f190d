"""Base of all MuJoCo games: the loop around the rules. A game is a subclass with four methods."""

from __future__ import annotations

import json
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from apil_core import NO_WINNER, ApilError, Colour, Game, GameLayout, GameStep, SideLayout, Window
from apil_envs.arrays import Array
from apil_envs.observe import Block, Observer
from apil_envs.options import PhysicsOptions
from apil_envs.physics import Physics
from apil_envs.render import Studio
from apil_envs.robot import Robot
from apil_envs.scene import TOUCH, Scene, build_scene
from apil_envs.stopwatch import BatchStopwatch

GOES_ON = -1
"""Value of :attr:`Verdict.cause` until a game ends."""

START_NOISE = 0.1
"""Half width of the noise on starting positions, and deviation of starting velocities."""

DIVERGED = "diverged"
"""Cause of a game that ended because its physics broke: a tie without rewards, last in every game's list."""


@dataclass
class Verdict:
    """Decision of the rules about every game after a step.

    Attributes:
        cause: (n,) int8, index into the game's causes, or :data:`GOES_ON`.
        winner: (n,) int8, 0, 1 or ``NO_WINNER``.
        sparse: outcome reward per side, (2, n).
    """

    cause: Array
    winner: Array
    sparse: Array


class MujocoGame(Game):
    """Base of the MuJoCo games: steps the physics, applies the rules, assembles observations, counts steps.

    Subclasses set the four class attributes and implement :meth:`observation_blocks`, :meth:`judge` and
    :meth:`move_rewards`, and as needed :meth:`set_up`, :meth:`place` and :meth:`rule_state`.

    Args:
        num_envs: number of games, n.
        threads: of the physics (0: all CPUs).
        options: of the game; default: those of ``options_model``.

    Attributes:
        scene: description of the scene, or the name of one in ``bodies.json``.
        side_names: of side 0 and 1.
        causes: ways a game can end, the last of them :data:`DIVERGED`.
        touch: two bodies whose contact (descendant bodies included) is :attr:`touching`, or ``None``.
        options: as given.
        physics: the simulations.
        robots: both sides' live views.
        clock: steps played in each game, (n,) int32.
        raw_actions: of both sides in this step, not clipped, each (n, actions).
    """

    scene: Scene | str
    side_names: tuple[str, str]
    causes: tuple[str, ...]
    touch: tuple[str, str] | None = None
    options_model: type[PhysicsOptions] = PhysicsOptions

    def __init__(self, num_envs: int, threads: int = 1, options: PhysicsOptions | None = None):
        self.options = options or self.options_model()
        self.num_envs = num_envs
        model = build_scene(self.scene, self.options, self.touch)
        self.physics = Physics(model, num_envs, threads, self.options.resolved)
        self.seconds_per_step = self.physics.seconds_per_step
        self._studio = Studio(self.physics)
        self.robots = (Robot(self.physics, 0), Robot(self.physics, 1))
        self.max_steps = self.options.max_steps
        self.clock = np.zeros(num_envs, np.int32)
        self.raw_actions: tuple[Array, Array] = (self.robots[0].ctrl, self.robots[1].ctrl)
        self._touch = None if self.touch is None else self.physics.sensor(TOUCH)
        self._over = np.ones(num_envs, bool)
        self._centre_before = np.zeros((2, num_envs, 3))
        self._rng = np.random.default_rng(0)
        self.set_up()
        self.observers = tuple(Observer(self.observation_blocks(side), num_envs) for side in (0, 1))
        first, second = (self._side_layout(side) for side in (0, 1))
        self.layout = GameLayout((first, second), self.max_steps, self.causes)

    # --- implemented by subclasses

    def set_up(self) -> None:
        """Create game-specific state. Called once, after ``physics`` and ``robots`` are created."""

    @abstractmethod
    def observation_blocks(self, side: int) -> list[Block]:
        """The blocks of a side's observation, in order. Called once, from the constructor."""

    def place(self, rows: Array, rng: np.random.Generator) -> None:
        """Start new games in ``rows`` (indices): write qpos and qvel, clear the game's rule state.

        By default all bodies start in the scene's pose plus noise: U(−0.1, 0.1) on every position
        coordinate (quaternions too: they are normalised afterwards), N(0, 0.1) on every velocity.
        """
        n, default = len(rows), self.physics.model.qpos0
        self.physics.qpos[rows] = default + rng.uniform(-START_NOISE, START_NOISE, (n, default.size))
        self.physics.qvel[rows] = START_NOISE * rng.standard_normal((n, self.physics.qvel.shape[1]))

    @abstractmethod
    def judge(self) -> Verdict:
        """Apply the rules to the state after a step (``clock`` counts that step already)."""

    @abstractmethod
    def move_rewards(self, moved: Array, verdict: Verdict) -> tuple[Array, Array]:
        """Dense and shaping rewards, each (2, n).

        Args:
            moved: displacement of both mass centres in this step, (2, n, 3), m.
            verdict: result of :meth:`judge`.
        """

    def rule_state(self) -> dict[str, Array]:
        """Live arrays of game-specific state that checkpoints store, each with n rows."""
        return {}

    # --- queries for subclasses

    @property
    def touching(self) -> Array:
        """True where the two bodies of ``touch`` are in contact at a distance below 0, (n,) bool."""
        assert self._touch is not None, "this game names no bodies in `touch`"
        return (self._touch[:, 0] > 0) & (self._touch[:, 1] < 0)

    @property
    def heights(self) -> Array:
        """Height of both roots, (2, n), m."""
        return np.stack([robot.height for robot in self.robots])

    # --- the interface of apil_core.Game

    @property
    def settings(self) -> dict[str, Any]:
        """See :class:`apil_core.Game`."""
        return self.options.settings

    @property
    def observations(self) -> tuple[Array, Array]:
        """See :class:`apil_core.Game`."""
        return self.observers[0].current, self.observers[1].current

    def seed(self, seed: int) -> None:
        """See :class:`apil_core.Game`."""
        self._rng = np.random.default_rng(seed)

    def reset(self, mask: Array | None = None) -> None:
        """See :class:`apil_core.Game`."""
        mask = np.ones(self.num_envs, bool) if mask is None else mask
        rows = np.flatnonzero(mask)
        if not rows.size:
            return
        self.physics.clear(mask)
        self.place(rows, self._rng)
        self.physics.forward(mask)
        self.clock[rows] = 0
        self._over[rows] = False
        for side in (0, 1):
            self._centre_before[side, rows] = self.robots[side].centre[rows]
            self.observers[side].refresh(rows)

    def step(self, actions: tuple[Array, Array], active: Array | None = None) -> GameStep:
        """See :class:`apil_core.Game`.

        Raises:
            ApilError: no game was ever reset.
        """
        playing = ~self._over if active is None else ~self._over & active
        if self._over.all() and not self.clock.any():
            raise ApilError(f"{type(self).__name__}: call reset() before the first step()")
        some = None if playing.all() else playing
        self.raw_actions = actions
        for robot, action in zip(self.robots, actions, strict=True):
            np.clip(action, *robot.bounds, out=robot.ctrl, casting="same_kind")
        diverged = self.physics.step(some) & playing
        self.clock[playing] += 1
        step = self._score(playing, diverged)
        self._over |= step.done
        for observer in self.observers:
            observer.advance(some)
        return step

    def state_dict(self) -> dict[str, Any]:
        """See :class:`apil_core.Game`."""
        return {
            "physics": self.physics.state.copy(),
            "clock": self.clock.copy(),
            "over": self._over.copy(),
            "centre_before": self._centre_before.copy(),
            "observations": {str(side): self.observations[side].copy() for side in (0, 1)},
            "rules": {name: array.copy() for name, array in self.rule_state().items()},
            "random": json.dumps(self._rng.bit_generator.state),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :class:`apil_core.Game`."""
        self.physics.state[...] = state["physics"]
        self.physics.show()
        self.clock[...] = state["clock"]
        self._over[...] = state["over"]
        self._centre_before[...] = state["centre_before"]
        for side, observer in enumerate(self.observers):
            observer.restore(state["observations"][str(side)])
        for name, array in self.rule_state().items():
            array[...] = state["rules"][name]
        self._rng.bit_generator.state = json.loads(state["random"])

    def render(self, row: int, width: int, height: int, colours: tuple[Colour, Colour]) -> Array:
        """See :class:`apil_core.Game`."""
        return self._studio.paint(row, width, height, colours)

    def open_window(self, row: int, colours: tuple[Colour, Colour]) -> Window:
        """See :class:`apil_core.Game`."""
        from apil_envs.window import ViewerWindow

        return ViewerWindow(self.physics, row, colours)

    def physics_stopwatch(self) -> BatchStopwatch:
        """See :class:`apil_core.Game`."""
        return self.physics.stopwatch()

    def close(self) -> None:
        """See :class:`apil_core.Game`."""
        self._studio.close()

    # --- details

    def _score(self, playing: Array, diverged: Array) -> GameStep:
        """Rewards and endings of this step; zero for games that did not play or diverged."""
        centre = np.stack([robot.centre for robot in self.robots])
        verdict = self.judge()
        dense, shaping = self.move_rewards(centre - self._centre_before, verdict)
        np.copyto(self._centre_before, centre, where=playing[:, None])
        counts = playing & ~diverged
        done = counts & (verdict.cause != GOES_ON) | diverged
        cause = np.where(diverged, np.int8(len(self.causes) - 1), verdict.cause)
        return GameStep(
            sparse=np.where(counts, verdict.sparse, 0).astype(np.float32),
            dense=np.where(counts, dense, 0).astype(np.float32),
            shaping=np.where(counts, shaping, 0).astype(np.float32),
            done=done,
            winner=np.where(done & ~diverged, verdict.winner, np.int8(NO_WINNER)),
            cause=np.where(done, cause, np.int8(GOES_ON)),
            lengths=self.clock.copy(),
        )

    def _side_layout(self, side: int) -> SideLayout:
        observer, robot = self.observers[side], self.robots[side]
        return SideLayout(
            name=self.side_names[side],
            observation_size=observer.size,
            action_size=robot.ctrl.shape[1],
            action_low=robot.bounds[0],
            action_high=robot.bounds[1],
            blocks=observer.blocks,
            opponent_channels=observer.opponent_channels,
        )
