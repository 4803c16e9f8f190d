"""``check_victim``: check a policy as a victim, from its name to a score."""

from __future__ import annotations

import copy
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.types import View
from apil_core.common.errors import PluginError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import evaluate
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.plugins.registry import make_game
from apil_core.policies.conformance import examine
from apil_core.policies.loading import LoadOptions, load_victim
from apil_core.testing.checks import VICTIM_CHECKS, ContractError, Subject, checking
from apil_core.testing.reports import VictimReport

GAMES, STEPS, EPISODES = 4, 5, 8
_DIGEST = re.compile(r"[0-9a-f]{64}")


@dataclass
class Candidate(Subject):
    """A victim under test.

    Attributes:
        game: with the seat it takes; not stepped.
        side: index of the seat.
        registry: in which the name is looked up.
    """

    kind = "victim"
    checks = VICTIM_CHECKS

    game: Game
    side: int
    registry: PluginRegistry

    @checking("load")
    def load(self, name: str) -> Policy:
        """Load the policy of that name for the seat, trusted, since its author runs the check."""
        return load_victim(name, self.game, self.side, "cpu", self.registry, LoadOptions(trust=True))

    def acts(self, policy: Policy, steps: range, generator: torch.Generator) -> Tensor:
        """Actions of a policy in steps of one sequence of made-up observations, (steps, GAMES, a)."""
        sides = self.game.layout.sides
        own, opponent = sides[self.side], sides[1 - self.side]
        chosen = []
        for step in steps:
            drawn = torch.Generator().manual_seed(step)
            view = View(
                torch.randn(GAMES, own.observation_size, generator=drawn),
                torch.randn(GAMES, opponent.observation_size, generator=drawn),
                torch.full((GAMES,), step == 0),
            )
            with torch.no_grad():
                chosen.append(policy.act(view, sample=True, generator=generator).action.clone())
        return torch.stack(chosen)


def check_victim(
    name: str, env: str, *, plugins: Sequence[str | Path] = (), side: Literal[0, 1] | None = None
) -> VictimReport:
    """Check that a policy can be a victim: loads by name, acts correctly, and is deterministic.

    docs/testing.md lists the checks and shows a failure. Code that the name may run is trusted.

    Args:
        name: of the policy.
        env: the game in which it takes a seat.
        plugins: files of one-file plugins.
        side: index of the seat; default: the game's victim's.

    Returns:
        the checks made, and its score against noise; ``print`` it.

    Raises:
        ContractError: the first check that fails.
        UnknownNameError: no game has that name.
    """
    begin = time.process_time()
    try:
        registry = discover(plugins)
    except PluginError as error:
        raise ContractError(f"victim {name!r}", VICTIM_CHECKS["load"], str(error)) from error
    spec = registry.game(env)
    game = make_game(env, num_envs=GAMES, threads=1, plugins=registry)
    try:
        candidate = Candidate(name, game, spec.victim_side if side is None else side, registry)
        with one_torch_thread(), torch.random.fork_rng(devices=[]):
            policy = check_identity(candidate)
            notes = check_acting(candidate, policy)
            check_same(candidate)
            result = check_playing(candidate, env)
    finally:
        game.close()
    return VictimReport(
        name=policy.info.name,
        env=env,
        side=game.layout.sides[candidate.side].name,
        sha256=policy.info.sha256,
        checked=candidate.checked(),
        notes=notes,
        wins=result.losses,
        ties=result.ties,
        losses=result.wins,
        seconds=time.process_time() - begin,
    )


@checking("load")
def check_identity(candidate: Candidate) -> Policy:
    """Check that it loads, under its own name, with the same hash."""
    policy = candidate.load(candidate.name)
    info, again = policy.info, candidate.load(policy.info.name).info
    text = f"it says its name is {info.name!r}, which loads one named {again.name!r}"
    candidate.need(again.name == info.name, text)
    with candidate.check("hash"):
        digest = _DIGEST.fullmatch(info.sha256)
        candidate.need(digest, f"info.sha256 must be 64 hex digits, got {info.sha256!r}")
        candidate.need(again.sha256 == info.sha256, "loaded twice, it has two hashes")
    return policy


@checking("acts")
def check_acting(candidate: Candidate, policy: Policy) -> list[str]:
    """Run the checks of ``apil victims check``; return its notes."""
    sides = candidate.game.layout.sides
    found = examine(policy, sides[candidate.side], sides[1 - candidate.side])
    candidate.need(not found.errors, next(iter(found.errors), ""))
    traits = {"recurrent": found.recurrent, "stochastic": found.stochastic}
    return [*found.notes, *(name for name, has in traits.items() if has)]


@checking("same")
def check_same(candidate: Candidate) -> None:
    """Check that two copies act alike, as does one that loads the other's state."""
    early, late = range(STEPS), range(STEPS, 2 * STEPS)
    one, other, third = (candidate.load(candidate.name) for _ in range(3))
    generators = [torch.Generator().manual_seed(0) for _ in range(2)]
    actions = []
    for policy, generator in zip((one, other), generators, strict=True):
        policy.seed(0)
        actions.append(candidate.acts(policy, early, generator))
    candidate.need(torch.equal(*actions), "loaded twice, it acts differently for the same seed")
    third.load_recurrent_state(copy.deepcopy(one.recurrent_state()))
    actions = [
        candidate.acts(policy, late, generator)
        for policy, generator in zip((one, third), generators, strict=True)
    ]
    text = "a copy that loads its recurrent_state() does not go on as it does"
    candidate.need(torch.equal(*actions), text)


@checking("play")
def check_playing(candidate: Candidate, env: str) -> EvaluationResult:
    """Play a few games against noise, twice."""
    seat: Literal[0, 1] = 1 if candidate.side else 0
    first, second = (
        evaluate(
            "random",
            env=env,
            victim=candidate.name,
            victim_seat=seat,
            episodes=EPISODES,
            threads=1,
            trust=True,
            plugins=candidate.registry,
        )
        for _ in range(2)
    )
    alike = (first.wins, first.ties, first.mean_length) == (second.wins, second.ties, second.mean_length)
    candidate.need(alike, "the same seed gave two scores")
    return first
