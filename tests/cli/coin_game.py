"""A one-file plugin with a game of a few numpy lines: five steps, the larger sum of actions wins."""

from __future__ import annotations

from typing import Any

import numpy as np

from apil_core import NO_WINNER, Game, GameLayout, GameSpec, GameStep, Section, SideLayout, hookimpl


class CoinConfig(Section):
    """Options of the game."""

    margin: float = 0.5
    """How much larger a sum must be to win."""


class CoinGame(Game):
    def __init__(self, num_envs: int, threads: int, options: CoinConfig):
        sides = [SideLayout(name, 2, 1, -1.0, 1.0, {"all": slice(0, 2)}, (1,)) for name in ("left", "right")]
        self.layout = GameLayout((sides[0], sides[1]), 5, ("margin", "even"))
        self.num_envs = num_envs
        self.margin = options.margin
        self.seed(0)
        self.sums = np.zeros((2, num_envs), np.float32)
        self.clock = np.zeros(num_envs, np.int32)
        self.reset()

    def seed(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)

    def reset(self, mask: Any = None) -> None:
        where = np.ones(self.num_envs, bool) if mask is None else mask
        self.sums[:, where] = self.random.normal(0, 0.5, (2, int(where.sum())))
        self.clock[where] = 0
        self._observe()

    def _observe(self) -> None:
        own, other = self.sums
        self._observations = (np.stack([own, other], 1), np.stack([other, own], 1))

    @property
    def observations(self) -> Any:
        return self._observations

    def step(self, actions: Any, active: Any = None) -> GameStep:
        active = np.ones(self.num_envs, bool) if active is None else active
        moves = np.stack([np.clip(a[:, 0], -1, 1) for a in actions]) * active
        self.sums = (self.sums + moves).astype(np.float32)
        self.clock += active
        self._observe()
        done = (self.clock >= 5) & active
        lead = self.sums[0] - self.sums[1]
        winner = np.where(lead > self.margin, 0, np.where(lead < -self.margin, 1, NO_WINNER))
        winner = np.where(done, winner, NO_WINNER).astype(np.int8)
        sign = np.where(winner == NO_WINNER, 0, 1 - 2.0 * winner) * done * 1000
        return GameStep(
            sparse=np.stack([sign, -sign]).astype(np.float32),
            dense=moves.astype(np.float32),
            shaping=moves.astype(np.float32),
            done=done,
            winner=winner,
            cause=(winner == NO_WINNER).astype(np.int8),
            lengths=self.clock.copy(),
        )

    def state_dict(self) -> dict[str, Any]:
        return {"sums": self.sums, "clock": self.clock, "random": repr(self.random.bit_generator.state)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.sums, self.clock = np.asarray(state["sums"]).copy(), np.asarray(state["clock"]).copy()
        self.random.bit_generator.state = eval(state["random"])
        self._observe()


@hookimpl
def register_games() -> list[GameSpec]:
    return [
        GameSpec(
            "coin",
            "coin_game:CoinGame",
            "the larger sum wins",
            sides=("left", "right"),
            default_victim="baseline:zero/2x1",
            config="coin_game:CoinConfig",
        )
    ]
