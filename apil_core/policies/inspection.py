"""Report of ``apil victims check``: a policy's properties, and if it can play a seat."""

from __future__ import annotations

import time

import torch
from pydantic import BaseModel

from apil_core.api.game import GameLayout
from apil_core.api.policy import Policy
from apil_core.api.types import View
from apil_core.common.documents import EXACT
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import game_spec, load_policy, named_side
from apil_core.policies.conformance import Conformance, examine
from apil_core.policies.loading import full_name

GAMES = 128
_SECONDS = 0.3


class Inspection(BaseModel):
    """Report on a policy in a seat.

    Attributes:
        name, sha256, provenance: its identity.
        game, side: the seat.
        observation_size, action_size: its own.
        action_bounds: it was made for, or ``None`` if it does not state them.
        recurrent, stochastic: see :class:`apil_core.policies.conformance.Conformance`; ``None``: it could
            not be run.
        steps_per_second: decisions for single games, :data:`GAMES` at a time on one thread.
        errors: reasons why it cannot play the seat.
        notes: remarks for the user.
    """

    model_config = EXACT

    name: str
    sha256: str
    provenance: dict[str, str]
    game: str
    side: str
    observation_size: int
    action_size: int
    action_bounds: tuple[float, float] | None
    recurrent: bool | None
    stochastic: bool | None
    steps_per_second: float | None
    errors: list[str]
    notes: list[str]


def inspect_policy(
    name: str, env: str, side: str | None, plugins: PluginRegistry, *, trust: bool = False
) -> Inspection:
    """Load a policy, check it in a seat, and measure its speed.

    Args:
        name: of the policy, or a run's directory.
        env: the game.
        side: name of the seat; default: the one that is attacked.
        plugins: registry with both.
        trust: allow names whose loading runs user code.

    Raises:
        ApilError: there is no such game or side, or the policy cannot be loaded.
    """
    layout, index = named_side(env, side, plugins)
    seat, opponent = layout.sides[index], layout.sides[1 - index]
    policy = load_policy(full_name(name, seat), plugins=plugins, seat=seat, trust=trust)
    info = policy.info
    sizes = (info.observation_size, info.action_size)
    found, speed = Conformance(), None
    if sizes == (seat.observation_size, seat.action_size):
        with one_torch_thread():
            found = examine(policy, seat, opponent, second=index != game_spec(env, plugins).victim_side)
            speed = None if found.errors else _speed(policy, layout, index)
    else:
        found.errors.append(
            f"takes {sizes[0]} observations and gives {sizes[1]} actions, but the {seat.name} has "
            f"{seat.observation_size} and {seat.action_size}"
        )
    tried = speed is not None
    return Inspection(
        name=info.name,
        sha256=info.sha256,
        provenance=info.provenance,
        game=env,
        side=seat.name,
        observation_size=sizes[0],
        action_size=sizes[1],
        action_bounds=info.action_bounds,
        recurrent=found.recurrent if tried else None,
        stochastic=found.stochastic if tried else None,
        steps_per_second=speed,
        errors=found.errors,
        notes=found.notes,
    )


def _speed(policy: Policy, layout: GameLayout, index: int) -> float:
    seat, opponent = layout.sides[index], layout.sides[1 - index]
    generator = torch.Generator().manual_seed(0)
    own = torch.randn(GAMES, seat.observation_size, generator=generator)
    other = torch.randn(GAMES, opponent.observation_size, generator=generator)
    action = torch.zeros(GAMES, opponent.action_size)
    policy.act(View(own, other, torch.ones(GAMES, dtype=torch.bool), action), sample=True)
    view = View(own, other, torch.zeros(GAMES, dtype=torch.bool), action)
    begin, calls = time.perf_counter(), 0
    while time.perf_counter() - begin < _SECONDS:
        policy.act(view, sample=True, generator=generator)
        calls += 1
    return GAMES * calls / (time.perf_counter() - begin)
