"""Small PettingZoo environments, each odd in its own way; named as ``pettingzoo:games.odd_envs:…``."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from pettingzoo import ParallelEnv

UNIT = Box(-1, 1, (2,), np.float32)


class Race(ParallelEnv):
    """Whose place is further right after ``length`` steps, or beyond 3 before that, wins.

    ``"cart"`` has an asymmetric Box action and sees a Dict, ``"hare"`` chooses one of three and sees numbers.
    """

    metadata = {"name": "race", "render_fps": 4}

    def __init__(self, length: int = 12, says_winner: bool = False):
        self.possible_agents = ["cart", "hare"]
        self.agents: list[str] = []
        self.length = length
        self.says_winner = says_winner
        self.observation_spaces = {
            "cart": Dict({"who": Discrete(3), "place": Box(-np.inf, np.inf, (2,), np.float64)}),
            "hare": Box(-np.inf, np.inf, (2, 2), np.float32),
        }
        self.action_spaces = {
            "cart": Box(np.array([0, -3]), np.array([1, 5]), dtype=np.float32),
            "hare": Discrete(3, start=2),
        }

    def observation_space(self, agent: str) -> Any:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        return self.action_spaces[agent]

    def _see(self) -> dict[str, Any]:
        return {
            "cart": {"who": int(self.time % 3), "place": self.place.copy()},
            "hare": np.stack([self.place[::-1], [self.time, 0]]).astype(np.float32),
        }

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.random = np.random.default_rng(seed)
        self.place = self.random.normal(size=2)
        self.time = 0
        self.agents = list(self.possible_agents)
        return self._see(), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        assert self.action_spaces["cart"].contains(actions["cart"]), actions
        assert self.action_spaces["hare"].contains(actions["hare"]), actions
        self.time += 1
        way = np.array([actions["cart"].sum() / 4, (actions["hare"] - 3) / 2])
        self.place += way + self.random.normal(0, 0.1, 2)
        ends = [bool(place > 3) for place in self.place]
        late = self.time >= self.length
        rewards = {"cart": float(way[0]), "hare": float(way[1])}
        infos: dict[str, Any] = {agent: {} for agent in self.possible_agents}
        if self.says_winner and (any(ends) or late):
            infos["hare"]["winner"] = True
        terminations = dict(zip(self.possible_agents, ends, strict=True))
        self.agents = [] if any(ends) or late else self.agents
        return self._see(), rewards, terminations, dict.fromkeys(self.possible_agents, late), infos


class Masked(ParallelEnv):
    """Both choose one of four, of which a mask allows some; ``"first"`` may choose nothing every third step.

    A choice that its mask forbids is an error. Whose choices add up to more wins.
    """

    metadata = {"name": "masked"}

    def __init__(self, choices: int = 4, actions: Any = None):
        self.possible_agents = ["first", "second"]
        self.agents: list[str] = []
        self._action = Box(-1, 1, (4,)) if actions == "box" else Discrete(4)
        self._space = Dict({"action_mask": MultiBinary(choices), "observation": Box(0, 1, (2,))})

    def observation_space(self, agent: str) -> Any:
        return self._space

    def action_space(self, agent: str) -> Any:
        return self._action

    def _see(self) -> dict[str, Any]:
        self.masks = {agent: self.random.integers(0, 2, 4).astype(np.int8) for agent in self.possible_agents}
        self.masks["second"][self.time % 4] = 1
        if self.time % 3 == 2:
            self.masks["first"][:] = 0
        seen = self.random.random((2, 2)).astype(np.float32)
        return {
            agent: {"action_mask": self.masks[agent], "observation": row}
            for agent, row in zip(self.possible_agents, seen, strict=True)
        }

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.random = np.random.default_rng(seed)
        self.time = 0
        self.agents = list(self.possible_agents)
        return self._see(), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        for agent, mask in self.masks.items():
            if mask.any() and not mask[actions[agent]]:
                raise ValueError(f"{agent} chose {actions[agent]}, which is forbidden")
        self.time += 1
        late = self.time >= 12
        self.agents = [] if late else self.agents
        rewards = {agent: float(action) for agent, action in actions.items()}
        none = dict.fromkeys(self.possible_agents, False)
        return self._see(), rewards, none, dict.fromkeys(none, late), {agent: {} for agent in none}


class Scripted(ParallelEnv):
    """Two agents of which nothing matters but what ``plan`` says: what to return in each step.

    Args:
        plan: per step from 1, any of ``rewards``, ``out`` (agents terminated), ``cut`` (agents truncated),
            ``gone`` (agents not observed any more), ``left`` (those not in ``agents``), ``seen`` (the first
            number of both observations), ``sees`` (observations), ``pay`` (rewards as they are), ``infos``,
            ``say`` (printed), ``raise`` (text), ``exit`` (the process ends). The first trial plays ten steps
            only.
        agents, actions, observations: names, and kinds of spaces.
    """

    metadata = {"name": "scripted"}

    def __init__(
        self,
        plan: dict[int, dict[str, Any]] | None = None,
        agents: tuple[str, ...] = ("a", "b"),
        actions: str = "box",
        observations: str = "box",
    ):
        self.plan = {int(time): what for time, what in (plan or {}).items()}
        self.possible_agents = list(agents)
        self.agents: list[str] = []
        self._actions = {
            "box": UNIT,
            "endless": Box(-np.inf, np.inf, (2,)),
            "whole": Box(0, 10, (1,), np.int32),
            "multi": MultiDiscrete([2, 2]),
        }[actions]
        self._observations = {
            "box": UNIT,
            "discrete": Discrete(4),
            "binary": MultiBinary(3),
            "whole": Box(0, 255, (2,), np.uint8),
            "multi": MultiDiscrete([3, 2]),
            "parts": Tuple(
                (Discrete(2, start=-1), Dict({"b": MultiDiscrete([2, 3]), "a": Box(0, 1, (1, 2))}))
            ),
        }[observations]

    def observation_space(self, agent: str) -> Any:
        return self._observations

    def action_space(self, agent: str) -> Any:
        return self._actions

    def _see(self, first: float = 0.5) -> Any:
        if self._observations is UNIT:
            return np.array([first, 0.25], np.float32)
        if isinstance(self._observations, Tuple):
            return (-1, {"a": np.array([[0.5, 1]], np.float32), "b": np.array([1, 2])})
        if isinstance(self._observations, Box | MultiDiscrete):
            return np.array([2, 1], self._observations.dtype)
        return 3 if isinstance(self._observations, Discrete) else np.array([1, 0, 1], np.int8)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.time = 0
        self.agents = list(self.possible_agents)
        return {agent: self._see() for agent in self.agents}, {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        self.time += 1
        now = self.plan.get(self.time, {})
        if "say" in now:
            print(now["say"])
        if "exit" in now:
            os._exit(3)
        if "raise" in now:
            raise KeyError(now["raise"])
        self.agents = [agent for agent in self.agents if agent not in now.get("left", ())]
        here = [agent for agent in self.possible_agents if agent not in now.get("gone", ())]
        return (
            {agent: self._see(float(now.get("seen", 0.5))) for agent in here} | now.get("sees", {}),
            {agent: float(now.get("rewards", {}).get(agent, 0)) for agent in here} | now.get("pay", {}),
            {agent: agent in now.get("out", ()) for agent in self.possible_agents},
            {agent: agent in now.get("cut", ()) for agent in self.possible_agents},
            now.get("infos", {}),
        )


class Careless(Race):
    """Ignores the seed."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        return super().reset(int.from_bytes(os.urandom(4)))


class Unlisted(Race):
    """Does not say who plays."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        seen = super().reset(seed)
        self.agents = []
        return seen


def broken_maker() -> None:
    raise OSError("no licence file")


class Odd(BaseException):
    """No Exception, as some libraries' own."""


def strange_maker() -> None:
    raise Odd("no way")


def no_env() -> dict[str, int]:
    return {}
