"""Several policies in one seat, drawn anew for every game or for every step."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View

Mix = Literal["per_episode", "per_step"]


class MixturePolicy(Policy):
    """Plays as one of its policies in each game, or draws one for each step.

    All of them follow all games, so that each one's recurrent state is that of a policy which watched the
    game from its start.

    Attributes:
        turn: (n,), index of the policy that acted last in each game; for a game that has just
            ended, the one that played it.

    Args:
        policies: of one seat, at least one.
        shares: how often each one plays, scaled to sum to 1; at 0 it is never called.
        mix: draw for each game or for each step.
        seed: of these draws.
    """

    def __init__(self, policies: Sequence[Policy], shares: Sequence[float], mix: Mix, seed: int = 0):
        if len(policies) != len(shares) or min(shares, default=-1) < 0 or not sum(shares):
            raise ValueError(f"{len(policies)} policies need as many shares, got {list(shares)}")
        self.policies = list(policies)
        self._asked = [k for k, share in enumerate(shares) if share]
        self.mix = mix
        first = policies[0].info
        digest = hashlib.sha256(" ".join(p.info.sha256 for p in policies).encode())
        name = f"mixture({', '.join(p.info.name for p in policies)})"
        self.info = PolicyInfo(name, digest.hexdigest(), first.observation_size, first.action_size)
        self._bounds = (torch.tensor(shares, dtype=torch.float64) / sum(shares)).cumsum(0)[:-1]
        self._draws = torch.Generator().manual_seed(seed)
        self.turn = torch.zeros(0, dtype=torch.long)

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; returns no activations."""
        self._take_turns(view.first)
        decisions = {k: self.policies[k].act(view, sample=sample, generator=generator) for k in self._asked}
        action = self._chosen({k: decision.action for k, decision in decisions.items()})
        return Decision(action, self._distribution(decisions, action), {} if activations else None)

    def _take_turns(self, first: Tensor) -> None:
        if len(self.turn) != len(first):
            self.turn = torch.zeros_like(first, dtype=torch.long)
        if self.mix == "per_step" or bool(first.any()):
            drawn = torch.rand(len(first), generator=self._draws, dtype=torch.float64)
            turn = torch.bucketize(drawn, self._bounds, right=True).to(first.device)
            self.turn = turn if self.mix == "per_step" else torch.where(first, turn, self.turn)

    def _chosen(self, values: Mapping[int, Tensor]) -> Tensor:
        """Row i of the output of the policy that acts in game i."""
        (_, chosen), *others = values.items()
        for k, value in others:
            chosen = torch.where((self.turn == k).unsqueeze(1), value, chosen)
        return chosen

    def _distribution(self, decisions: Mapping[int, Decision], action: Tensor) -> DiagonalGaussian | None:
        given = {k: each.distribution for k, each in decisions.items() if each.distribution is not None}
        if len(given) < len(decisions):
            return None
        std = self._chosen({k: each.std.expand_as(action) for k, each in given.items()})
        return DiagonalGaussian(self._chosen({k: each.mean for k, each in given.items()}), std)

    def to(self, device: torch.device | str) -> MixturePolicy:
        """Move all policies; returns self."""
        self.policies = [policy.to(device) for policy in self.policies]
        self.turn = self.turn.to(device)
        return self

    def seed(self, seed: int) -> None:
        """Seed the draws and the policies' own generators."""
        self._draws.manual_seed(seed)
        for i, policy in enumerate(self.policies, 1):
            policy.seed(seed + i)

    def recurrent_state(self) -> dict[str, Any]:
        """Return the present policy of each game, the generator, and every policy's own state."""
        states = {str(i): policy.recurrent_state() for i, policy in enumerate(self.policies)}
        return {"turn": self.turn.clone(), "draws": self._draws.get_state(), "policies": states}

    def load_recurrent_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`recurrent_state` returned; an empty one resets all games."""
        own = state or {"turn": self.turn[:0], "policies": {}}
        self.turn = own["turn"].to(self.turn.device, copy=True)
        if state:
            self._draws.set_state(state["draws"].cpu())
        for i, policy in enumerate(self.policies):
            policy.load_recurrent_state(own["policies"].get(str(i), {}))
