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

from apil_core.api.game import Array, Game, GameStep, SideLayout
from apil_core.common import colours
from apil_core.common.errors import ConfigError

if TYPE_CHECKING:
    from apil_core.api.policy import Policy


def _single_game(game: Game | str, options: dict[str, Any] | None) -> Game:
    if isinstance(game, str):
        from apil_core.plugins.registry import make_game

        return make_game(game, num_envs=1, options=options)
    if options is not None:
        raise ConfigError("options need the name of a game, not a ready one")
    if game.num_envs != 1:
        raise ConfigError(f"a view shows one game, this one has num_envs={game.num_envs}")
    return game


def _observation_space(side: SideLayout) -> Box:
    return Box(-np.inf, np.inf, (side.observation_size,), np.float32)


def _action_space(side: SideLayout) -> Box | Discrete:
    """Space of a side's actions; ``Discrete`` where the core expects scores: the caller chooses itself."""
    if side.discrete:
        return Discrete(side.action_size)
    return Box(side.action_low, side.action_high, (side.action_size,), np.float32)


def _row(action: Any, space: Space[Any]) -> Array:
    if isinstance(space, Discrete):
        return np.eye(int(space.n), dtype=np.float32)[[int(action)]]
    return np.asarray(action, np.float32)[None]


def _info(game: Game, step: GameStep, side: int) -> dict[str, Any]:
    """``reward_move`` and ``sparse``; ``winner`` (bool) and ``cause`` (str) when the game has ended."""
    info: dict[str, Any] = {
        "reward_move": float(step.shaping[side, 0]),
        "sparse": float(step.sparse[side, 0]),
    }
    if step.done[0]:
        info["winner"] = bool(step.winner[0] == side)
        info["cause"] = game.layout.causes[int(step.cause[0])]
    return info


PICTURE = (640, 360)
"""Width and height of the views' pictures, pixels."""


def _check_render_mode(render_mode: str | None) -> None:
    if render_mode not in (None, "rgb_array"):
        raise ConfigError(f"render_mode {render_mode!r} is unknown; there is 'rgb_array'")


def _picture(game: Game, adversary_side: int, render_mode: str | None) -> Array | None:
    """Picture for ``render``, victim blue and adversary red; ``None`` without a render mode."""
    if render_mode is None:
        return None
    return game.render(0, *PICTURE, colours.by_side(adversary_side))


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
        _check_render_mode(render_mode)
        self.render_mode = render_mode
        self._game = _single_game(game, options)
        sides = self._game.layout.sides
        self.possible_agents = [side.name for side in sides]
        self.agents: list[str] = []
        self.observation_spaces = {side.name: _observation_space(side) for side in sides}
        self.action_spaces = {side.name: _action_space(side) for side in sides}
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
        return _picture(self._game, 1, self.render_mode)

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
        import torch

        from apil_core.games.two_players import TwoPlayerGames

        _check_render_mode(render_mode)
        self.render_mode = render_mode

        self._torch = torch
        self._game = _single_game(game, options)
        if isinstance(game, str):
            from apil_core.plugins.default_victim import default_victim
            from apil_core.plugins.registry import default_plugins

            plugins = default_plugins()
            spec = plugins.game(game)
            side = 1 - spec.victim_side if side is None else side
            opponent = opponent or default_victim(spec, plugins) or None
        self._side = 1 if side is None else side
        self._opponent = self._load(opponent)
        self._sample = sample
        self._generator = torch.Generator()
        own = self._game.layout.sides[self._side]
        self.observation_space = _observation_space(own)
        self.action_space = _action_space(own)
        self._games = TwoPlayerGames(self._game)
        self._seeded = False

    def _load(self, opponent: Policy | str | None) -> Policy:
        if opponent is None:
            raise ConfigError("OpponentInsideEnv needs an opponent: a policy or the name of one")
        if isinstance(opponent, str):
            from apil_core.plugins.registry import load_policy
            from apil_core.policies.loading import full_name

            seat = self._game.layout.sides[1 - self._side]
            return load_policy(full_name(opponent, seat), seat=seat)
        return opponent

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start a new game; without a seed the random generators continue (initially seeded from entropy)."""
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            start = secrets.randbits(32) if seed is None else seed
            self._game.seed(start)
            self._generator.manual_seed(start)
            self._opponent.seed(start)
            self._seeded = True
        self._games.reset()
        return self._observation(), {}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One control step of both sides."""
        with self._torch.no_grad():
            view = self._games.view(1 - self._side)
            decision = self._opponent.act(view, sample=self._sample, generator=self._generator)
        own = self._torch.tensor(_row(action, self.action_space))
        step = self._games.step({self._side: own, 1 - self._side: decision.action})
        reward = float(step.sparse[self._side, 0] + step.dense[self._side, 0])
        info = _info(self._game, step, self._side)
        return self._observation(), reward, bool(step.done[0]), False, info

    def render(self) -> Array | None:
        """Picture of the state, (360, 640, 3) uint8, opponent blue, caller red; see ``render_mode``."""
        return _picture(self._game, self._side, self.render_mode)

    def close(self) -> None:
        """Release the game's resources."""
        self._game.close()

    def _observation(self) -> Array:
        return self._game.observations[self._side][0].copy()
