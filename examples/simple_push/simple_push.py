"""MPE's simple_push as a game, with a scripted victim: a plugin in one file (README.md beside it)."""

from __future__ import annotations

import hashlib
from pathlib import Path

import torch
from pydantic import Field
from torch import Tensor

from apil_core import (
    Decision,
    DiagonalGaussian,
    GameSpec,
    PettingZooOptions,
    Policy,
    PolicyInfo,
    PolicyListing,
    PolicySpec,
    UnknownNameError,
    View,
    hookimpl,
    pettingzoo_spec,
)

VICTIM = "simple-push:runner/v1"


class SimplePushOptions(PettingZooOptions):
    """As for any PettingZoo environment, with the columns that describe the opponent filled in."""

    opponent_channels: dict[str, tuple[int, ...]] = Field(
        default={"adversary_0": (6, 7), "agent_0": (17, 18)}
    )
    """Per agent, where the other one stands, relative to it."""


class Runner(Policy):
    """Accelerates towards its goal, brakes near it, and evades a nearby adversary.

    Its five numbers serve both kinds of action: nothing, left, right, down, up, as scores of which the
    largest is chosen, or as strengths of which opposite ones are subtracted.
    """

    STD = 0.3
    ALERT = 0.4  # distance at which it starts to evade, in units of the arena (agents have a radius of 0.05)

    def __init__(self) -> None:
        digest = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
        self.info = PolicyInfo(VICTIM, digest, observation_size=19, action_size=5)
        self._std = torch.full((5,), self.STD)

    def mean(self, observation: Tensor) -> Tensor:
        """Mean action, (n, 5), a fixed function of the observation (n, 19) of agent_0."""
        velocity, goal, other = observation[:, 0:2], observation[:, 2:4], observation[:, 17:19]
        distance = other.norm(dim=1, keepdim=True).clamp_min(1e-6)
        alarm = (1 - distance / self.ALERT).clamp_min(0)
        x, y = (3 * goal - velocity - 2 * alarm * other / distance).clamp(-1, 1).unbind(1)
        return torch.stack([torch.zeros_like(x), -x, x, -y, y], dim=1)

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :class:`apil_core.Policy`; its only activation is the mean itself."""
        mean = self.mean(view.own)
        distribution = DiagonalGaussian(mean, self._std)
        action = distribution.sample(generator) if sample else mean
        return Decision(action, distribution, {"hidden": mean} if activations else None)

    def to(self, device: torch.device | str) -> Runner:
        """See :class:`apil_core.Policy`."""
        self._std = self._std.to(device)
        return self


def load(name: str) -> Policy:
    """Load the policy of that name (without ``simple-push:``).

    Raises:
        UnknownNameError: there is none.
    """
    if name != "runner/v1":
        raise UnknownNameError("policy", f"simple-push:{name}", [VICTIM])
    return Runner()


def listing() -> list[PolicyListing]:
    """Return one row for ``apil victims list``."""
    return [PolicyListing(VICTIM, True, Runner().info.sha256, "scripted, examples/simple_push")]


@hookimpl
def register_games() -> list[GameSpec]:
    """Register the game by its full name, so that the attacked side and the victim need not be given."""
    return [
        pettingzoo_spec(
            "mpe2.simple_push_v3:parallel_env",
            summary="MPE: a point wants to reach a landmark, another one to keep it away",
            sides=("adversary_0", "agent_0"),
            victim_side=1,
            default_victim=VICTIM,
            config=f"{__name__}:SimplePushOptions",
        )
    ]


@hookimpl
def register_policies() -> list[PolicySpec]:
    """Register the victim."""
    return [PolicySpec("simple-push", f"{__name__}:load", f"{__name__}:listing", "a scripted victim")]
