"""Build a distillation's game, teacher, opponent and trainer from its settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from apil_core.api.game import Game, SideLayout
from apil_core.api.policy import Policy
from apil_core.api.specs import GameSpec
from apil_core.api.types import View
from apil_core.common.errors import ConfigError, VictimError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.config.game import game_model, overlaid
from apil_core.plugins.default_victim import is_here
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.policies.loading import LoadOptions, load_victim
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.distillation.trainer import DistillTrainer
from apil_core.training.build import check_device

_LONGEST_BLOCK = 512


def named(config: DistillConfig, plugins: PluginRegistry) -> DistillConfig:
    """Return ``config`` with the full names of teacher and opponent.

    Raises:
        ConfigError: no such role, or no agent known for it.
    """
    spec = plugins.game(config.env)
    side = role_side(config, spec)
    both = spec.interchangeable_sides if config.both_seats is None else config.both_seats
    teacher = config.teacher if config.teacher != "auto" else agent(spec, side, plugins, "--teacher")
    opponent = config.opponent if config.opponent != "auto" else agent(spec, 1 - side, plugins, "--opponent")
    return config.model_copy(update={"teacher": teacher, "opponent": opponent, "both_seats": both})


def role_side(config: DistillConfig, spec: GameSpec) -> int:
    """Index of the student's seat."""
    if config.role not in spec.sides:
        raise ConfigError(f"{spec.name} has no side {config.role!r}; its sides: {', '.join(spec.sides)}")
    return spec.sides.index(config.role)


def agent(spec: GameSpec, side: int, plugins: PluginRegistry, flag: str) -> str:
    """Return the game's agent for a side, or its substitute where the weights are missing."""
    own = spec.default_victim if side == spec.victim_side else spec.baseline_adversary
    stand_ins = [match.adversary for match in spec.matchups if match.stands_in_for == own]
    here = [name for name in (own, *stand_ins) if name and is_here(name, plugins)]
    if here:
        return here[0]
    if own:
        return own  # the loading error says how to get it
    raise ConfigError(f"{spec.name} names no agent for the {spec.sides[side]}; name one with {flag}")


@one_torch_thread()
def prepare(config: DistillConfig, plugins: PluginRegistry) -> DistillTrainer:
    """Build everything; ``config`` comes from :func:`named`. Seeds torch's global generator.

    Raises:
        ApilError: anything wrong with names, options, weights or sizes.
    """
    device = check_device(config.device)
    side = role_side(config, plugins.game(config.env))
    game = _game(config, plugins, {})
    practice = _game(config, plugins, config.practice) if config.practice else game
    try:
        teacher, opponent = (
            load_victim(name, game, seat, config.device, plugins, LoadOptions(config.trust))
            for name, seat in ((config.teacher, side), (config.opponent, 1 - side))
        )
        seats = game.layout.sides
        log_std, recurrent = spread_of(teacher, seats[side], seats[1 - side], device)
        full = _complete(config, game.layout.max_steps, recurrent).model_copy(
            update={"teacher": teacher.info.name, "opponent": opponent.info.name}  # found from anywhere
        )
        torch.manual_seed(config.seed)  # the student's first weights
        return DistillTrainer(full, (game, practice), teacher, opponent, side, log_std)
    except BaseException:
        game.close()
        practice.close()
        raise


def _game(config: DistillConfig, plugins: PluginRegistry, changed: Mapping[str, Any]) -> Game:
    options = overlaid(game_model(config.env, plugins), config.game, changed)
    return make_game(
        config.env, num_envs=config.num_envs, threads=config.threads, options=options, plugins=plugins
    )


def spread_of(
    teacher: Policy, seat: SideLayout, other: SideLayout, device: torch.device
) -> tuple[Tensor, bool]:
    """Return the teacher's log-std (a,), and whether it has a recurrent state.

    Raises:
        VictimError: no distribution, or one whose spread depends on the observation.
    """
    rows = 4
    spread = torch.linspace(-1, 1, rows, device=device).unsqueeze(1)
    own = spread.expand(rows, seat.observation_size).contiguous()
    first = torch.ones(rows, dtype=torch.bool, device=device)
    theirs, answer = (
        torch.zeros(rows, size, device=device) for size in (other.observation_size, other.action_size)
    )
    view = View(own, theirs, first, opponent_action=answer)
    distribution = teacher.act(view, sample=False).distribution
    if distribution is None:
        raise VictimError(f"{teacher.info.name} has no action distribution: its mean cannot be learnt")
    std = distribution.std.expand(rows, -1)
    if not torch.equal(std, std[:1].expand(rows, -1)):
        raise VictimError(
            f"{teacher.info.name}: the spread of its actions depends on the observation; "
            "a student has one spread for all"
        )
    return std[0].log(), bool(teacher.recurrent_state())


def _complete(config: DistillConfig, max_steps: int, recurrent: bool) -> DistillConfig:
    kind = config.network if config.network != "auto" else ("lstm" if recurrent else "mlp")
    hidden = config.hidden
    if hidden is None:
        hidden = () if kind == "lstm" else (64, 64)
    filled = {
        "network": kind,
        "hidden": hidden,
        "block_steps": config.block_steps or min(max_steps, _LONGEST_BLOCK),
        # the zoo's tanh networks have large weights: small steps do not get there (docs/victims.md)
        "learning_rate": config.learning_rate or (2e-3 if kind == "lstm" else 1e-2),
    }
    return config.model_copy(update=filled)
