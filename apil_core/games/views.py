"""Single games for third-party tools: PettingZoo and Gymnasium environments.

Both are thin wrappers: the rules are in the :class:`apil_core.Game`, here with ``num_envs=1``.
"""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from pettingzoo import ParallelEnv

from apil_core.api.game import NO_WINNER, Array, Game, GameStep, SideLayout
from apil_core.common import colours
from apil_core.common.errors import ConfigError

if TYPE_CHECKING:
    from apil_core.api.policy import Policy


def game_of(game: Game | str, options: dict[str, Any] | None, num_envs: int | None, threads: int = 1) -> Game:
    """The game itself, or ``num_envs`` (``None``: 1) games of that name."""
    if num_envs is not None and num_envs < 1:
        raise ConfigError(f"num_envs must be at least 1, not {num_envs}")
    if isinstance(game, str):
        from apil_core.plugins.registry import make_game

        return make_game(game, num_envs=num_envs or 1, threads=threads, options=options)
    if options is not None:
        raise ConfigError("options need the name of a game, not a ready one")
    if num_envs not in (None, game.num_envs):
        raise ConfigError(f"the view needs num_envs={num_envs}, this game has num_envs={game.num_envs}")
    return game


def observation_space(side: SideLayout) -> Box:
    """Space of a side's observations, unbounded."""
    return Box(-np.inf, np.inf, (side.observation_size,), np.float32)


def action_space(side: SideLayout) -> Box | Discrete:
    """Space of a side's actions; ``Discrete`` where the core expects scores: the caller chooses itself."""
    if side.discrete:
        return Discrete(side.action_size)
    return Box(side.action_low, side.action_high, (side.action_size,), np.float32)


def _row(action: Any, space: Space[Any]) -> Array:
    if isinstance(space, Discrete):
        return np.eye(int(space.n), dtype=np.float32)[[int(action)]]
    return np.asarray(action, np.float32)[None]


def info_columns(game: Game, step: GameStep, side: int, *, ended: bool) -> dict[str, Array]:
    """A side's infos, (num_envs,) each: both rewards; if ``ended``, ``winner``, ``tie`` and ``cause``."""
    columns = {"reward_move": step.shaping[side].astype(float), "sparse": step.sparse[side].astype(float)}
    if ended:
        columns["winner"] = step.winner == side
        columns["tie"] = step.winner == NO_WINNER
        columns["cause"] = np.array(game.layout.causes, object)[step.cause]
    return columns


def _info(game: Game, step: GameStep, side: int) -> dict[str, Any]:
    """The same of the one game there is, as ``float``, ``bool`` and ``str``."""
    columns = info_columns(game, step, side, ended=bool(step.done[0]))
    return {key: column.tolist()[0] for key, column in columns.items()}


PICTURE = (640, 360)
"""Width and height of the views' pictures, pixels."""


def check_render_mode(render_mode: str | None) -> None:
    """Raise ConfigError for a mode that the views do not have."""
    if render_mode not in (None, "rgb_array"):
        raise ConfigError(f"render_mode {render_mode!r} is unknown; there is 'rgb_array'")


def picture(game: Game, adversary_side: int, row: int = 0) -> Array:
    """Picture of one game for ``render``, victim blue and adversary red."""
    return game.render(row, *PICTURE, colours.by_side(adversary_side))


class ParallelGameEnv(ParallelEnv[str, Array, Array]):
    """A game as a PettingZoo ``ParallelEnv``; the agents are named as the sides.

    A reward is sparse + dense, as the original games return it. Every ending is a termination, running
    out of time too, since that is an outcome with a reward; nothing is ever truncated.

    Args:
        game: a game with ``num_envs=1``, or a game's name.
        options: of the game, when given by name.
        render_mode: ``"rgb_array"`` lets :meth:`render` return pictures.

    Raises:
        UnknownNameError: there is no game of that name.
        ConfigError: ``game`` has several games, or the options or the render mode are wrong.
    """

    metadata = {"name": "apil_game", "render_modes": ["rgb_array"]}  # noqa: RUF012  (PettingZoo's own form)

    def __init__(
        self, game: Game | str, options: dict[str, Any] | None = None, render_mode: str | None = None
    ):
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self._game = game_of(game, options, 1)
        sides = self._game.layout.sides
        self.possible_agents = [side.name for side in sides]
        self.agents: list[str] = []
        self.observation_spaces = {side.name: observation_space(side) for side in sides}
        self.action_spaces = {side.name: action_space(side) for side in sides}
        self._seeded = False

    def observation_space(self, agent: str) -> Box:
        """Unbounded, (observation_size,), float32."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box | Discrete:
        """Bounds of the controls, (action_size,), float32; for a side that chooses, its number of choices."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Start a new game; without a seed the random generator continues (initially seeded from entropy)."""
        if seed is not None or not self._seeded:
            self._game.seed(secrets.randbits(32) if seed is None else seed)
            self._seeded = True
        self._game.reset()
        self.agents = list(self.possible_agents)
        return self._observations(), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, Array]
    ) -> tuple[
        dict[str, Array],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """One control step; returns empty dicts once the game is over."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        first, second = (_row(actions[agent], self.action_spaces[agent]) for agent in self.possible_agents)
        step = self._game.step((first, second))
        over = bool(step.done[0])
        named = list(enumerate(self.possible_agents))
        rewards = {agent: float(step.sparse[side, 0] + step.dense[side, 0]) for side, agent in named}
        infos = {agent: _info(self._game, step, side) for side, agent in named}
        terminations = dict.fromkeys(self.possible_agents, over)
        truncations = dict.fromkeys(self.possible_agents, False)
        if over:
            self.agents = []
        return self._observations(), rewards, terminations, truncations, infos

    def render(self) -> Array | None:
        """Picture of the state, (360, 640, 3) uint8, side 0 blue, side 1 red; see ``render_mode``."""
        return None if self.render_mode is None else picture(self._game, 1)

    def close(self) -> None:
        """Release the game's resources."""
        self._game.close()

    def _observations(self) -> dict[str, Array]:
        rows = zip(self.possible_agents, self._game.observations, strict=True)
        return {agent: row[0].copy() for agent, row in rows}


class OpponentInsideEnv(gymnasium.Env[Array, Any]):
    """A game as a Gymnasium ``Env``: a policy plays one side inside, the caller plays the other.

    Rewards and endings as in :class:`ParallelGameEnv`. A seed fixes the game and the policy's draws.

    Args:
        game: a game with ``num_envs=1``, or a game's name.
        opponent: the policy inside, or its name; ``None``: the game's default victim (needs a name).
        side: the caller's side, 0 or 1; ``None``: the adversary's, which is 1 for a ready game.
        sample: draw the opponent's actions; false takes their mode.
        options: of the game, when given by name.
        render_mode: ``"rgb_array"`` lets :meth:`render` return pictures.

    Raises:
        UnknownNameError: there is no game or policy of that name.
        ConfigError: see :class:`ParallelGameEnv`; or no opponent is known.
        VictimError: the opponent's weights are missing.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012  (Gymnasium's own form)

    def __init__(
        self,
        game: Game | str,
        opponent: Policy | str | None = None,
        *,
        side: int | None = None,
        sample: bool = True,
        options: dict[str, Any] | None = None,
        render_mode: str | None = None,
    ):
        from apil_core.games.vector import GameVectorEnv

        self._batch = GameVectorEnv(
            game,
            opponent,
            num_envs=1,
            threads=1,
            side=side,
            sample=sample,
            options=options,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self._batch.metadata["render_fps"]}
        self.observation_space = self._batch.single_observation_space
        self.action_space = self._batch.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start a new game; without a seed the random generators continue (initially seeded from entropy)."""
        super().reset(seed=seed)
        observations, info = self._batch.reset(seed=seed)
        return observations[0], info

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One control step of both sides."""
        step = self._batch._advance(np.asarray(action)[None])
        game, side = self._batch.game, self._batch.side
        reward = float(step.sparse[side, 0] + step.dense[side, 0])
        info = _info(game, step, side)
        return game.observations[side][0].copy(), reward, bool(step.done[0]), False, info

    def render(self) -> Array | None:
        """Picture of the state, (360, 640, 3) uint8, opponent blue, caller red; see ``render_mode``."""
        pictures = self._batch.render()
        return pictures[0] if pictures else None

    def close(self) -> None:
        """Release the game's resources."""
        self._batch.close()
