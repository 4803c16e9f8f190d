"""A step of two players: the victim acts, the adversary acts, all games advance, ended ones are reset."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from apil_core.api.game import Array, Game, GameStep
from apil_core.api.types import View


class TwoPlayerGames:
    """A batch of numpy games, played by torch policies.

    Training, distillation, scores, videos and the Gymnasium views step their games through this class. The
    victim acts first, and the adversary may get its action (an oracle reads it)::

        games = TwoPlayerGames(game, device)
        games.reset()
        for _ in range(steps):
            a = victim.act(games.view(0), sample=True, generator=generator).action
            b = adversary.act(games.view(1, a), sample=True, generator=generator).action
            result = games.step({0: a, 1: b})
            games.reset(result.done)

    Args:
        game: seeded by the caller; must not be stepped or reset elsewhere meanwhile.
        device: of the policies.
        observation_filter: ``f(side, observation)`` returns a side's filtered observation, (n, o) as
            before; called at most once per side and step.

    Attributes:
        first: (n,) bool, a new game starts with the present observation.
    """

    def __init__(
        self,
        game: Game,
        device: torch.device | str = "cpu",
        observation_filter: Callable[[int, Tensor], Tensor] | None = None,
    ):
        self.game = game
        self.device = torch.device(device)
        self.first = torch.ones(game.num_envs, dtype=torch.bool, device=self.device)
        self._filter = observation_filter
        self._seen: dict[int, Tensor] = {}

    def reset(self, mask: Array | None = None) -> None:
        """Start new games where ``mask`` (n,) bool is true; everywhere if it is ``None``."""
        if mask is not None and not mask.any():
            return
        self.game.reset(mask)
        self._seen.clear()
        if mask is None:
            self.first = torch.ones_like(self.first)
        else:
            self.first = torch.from_numpy(mask.copy()).to(self.device)

    def observation(self, side: int) -> Tensor:
        """Observation of a side, (n, o) float32; not changed by the next step, but by the one after it."""
        if side not in self._seen:
            seen = torch.from_numpy(self.game.observations[side]).to(self.device)
            self._seen[side] = seen if self._filter is None else self._filter(side, seen)
        return self._seen[side]

    def view(self, side: int, opponent_action: Tensor | None = None) -> View:
        """View of a policy in that seat.

        Args:
            side: 0 or 1.
            opponent_action: the other side's, (n, a'), if it has chosen already.
        """
        return View(self.observation(side), self.observation(1 - side), self.first, opponent_action)

    def step(self, actions: Mapping[int, Tensor], active: Array | None = None) -> GameStep:
        """Advance all games by one step; ended ones do not change until :meth:`reset`.

        Args:
            actions: by side, each (n, a), not clipped.
            active: (n,) bool, games to advance; ``None``: all.
        """
        result = self.game.step((actions[0].cpu().numpy(), actions[1].cpu().numpy()), active)
        self._seen.clear()
        self.first = torch.zeros_like(self.first)
        return result
