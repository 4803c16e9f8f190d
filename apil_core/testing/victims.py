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
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import evaluate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.policies.conformance import examine
from apil_core.policies.loading import LoadOptions, load_victim
from apil_core.testing.checks import VICTIM_CHECKS, ContractError, reported_as
from apil_core.testing.method_under_test import registry_with
from apil_core.testing.reports import VictimReport

GAMES, STEPS, EPISODES = 4, 5, 8
_DIGEST = re.compile(r"[0-9a-f]{64}")


@dataclass
class Candidate:
    """A victim under test.

    Attributes:
        name: as given.
        game: with the seat it takes; not stepped.
        side: index of the seat.
        registry: in which the name is looked up.
    """

    name: str
    game: Game
    side: int
    registry: PluginRegistry

    @property
    def who(self) -> str:
        """Name for messages."""
        return f"victim {self.name!r}"

    def broken(self, check: str, happened: str) -> ContractError:
        """Make the error for one of :data:`VICTIM_CHECKS`."""
        return ContractError(self.who, VICTIM_CHECKS[check], happened)

    def load(self, name: str) -> Policy:
        """Load the policy of that name for the seat, trusted, since its author runs the check."""
        with reported_as(self.who, VICTIM_CHECKS["load"]):
            return load_victim(name, self.game, self.side, "cpu", self.registry, LoadOptions(trust=True))


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
    registry = registry_with(f"victim {name!r}", VICTIM_CHECKS["load"], plugins)
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
        checked=[check.title for check in VICTIM_CHECKS.values()],
        notes=notes,
        wins=result.losses,
        ties=result.ties,
        losses=result.wins,
        seconds=time.process_time() - begin,
    )


def check_identity(candidate: Candidate) -> Policy:
    """Check that it loads, under its own name, with the same hash."""
    policy = candidate.load(candidate.name)
    again = candidate.load(policy.info.name)
    if again.info.name != policy.info.name:
        text = f"it says its name is {policy.info.name!r}, which loads one named {again.info.name!r}"
        raise candidate.broken("load", text)
    if not _DIGEST.fullmatch(policy.info.sha256):
        raise candidate.broken("hash", f"info.sha256 must be 64 hex digits, got {policy.info.sha256!r}")
    if again.info.sha256 != policy.info.sha256:
        raise candidate.broken("hash", "loaded twice, it has two hashes")
    return policy


def check_acting(candidate: Candidate, policy: Policy) -> list[str]:
    """Run the checks of ``apil victims check``; return its notes."""
    sides = candidate.game.layout.sides
    found = examine(policy, sides[candidate.side], sides[1 - candidate.side])
    for error in found.errors:
        raise candidate.broken("acts", error)
    traits = {"recurrent": found.recurrent, "stochastic": found.stochastic}
    return [*found.notes, *(name for name, has in traits.items() if has)]


def check_same(candidate: Candidate) -> None:
    """Check that two copies act alike, as does one that loads the other's state."""
    left, right = candidate.load(candidate.name), candidate.load(candidate.name)
    one, other = _Seated(candidate, left), _Seated(candidate, right)
    if not torch.equal(one.act(STEPS), other.act(STEPS)):
        raise candidate.broken("same", "loaded twice, it acts differently for the same seed")
    third = candidate.load(candidate.name)
    with reported_as(candidate.who, VICTIM_CHECKS["same"]):
        third.load_recurrent_state(copy.deepcopy(left.recurrent_state()))
    follower = _Seated(candidate, third, one.generator.get_state(), one.step)
    if not torch.equal(one.act(STEPS), follower.act(STEPS)):
        raise candidate.broken("same", "a copy that loads its recurrent_state() does not go on as it does")


class _Seated:
    """A policy that is shown the same artificial observations step by step."""

    def __init__(self, candidate: Candidate, policy: Policy, random: Tensor | None = None, step: int = 0):
        self.candidate, self.policy, self.step = candidate, policy, step
        self.generator = torch.Generator().manual_seed(0)
        if random is None:
            policy.seed(0)
        else:
            self.generator.set_state(random)

    def act(self, steps: int) -> Tensor:
        """Actions of the next steps, (steps, GAMES, a)."""
        sides = self.candidate.game.layout.sides
        own, opponent = sides[self.candidate.side], sides[1 - self.candidate.side]
        chosen = []
        for _ in range(steps):
            random = torch.Generator().manual_seed(self.step)
            view = View(
                torch.randn(GAMES, own.observation_size, generator=random),
                torch.randn(GAMES, opponent.observation_size, generator=random),
                torch.full((GAMES,), self.step == 0),
            )
            with torch.no_grad():
                decision = self.policy.act(view, sample=True, generator=self.generator)
            chosen.append(decision.action.clone())
            self.step += 1
        return torch.stack(chosen)


def check_playing(candidate: Candidate, env: str) -> EvaluationResult:
    """Play a few games against noise, twice."""
    with reported_as(candidate.who, VICTIM_CHECKS["play"]):
        results = [
            evaluate(
                "random",
                env=env,
                victim=candidate.name,
                victim_seat=1 if candidate.side else 0,
                episodes=EPISODES,
                threads=1,
                trust=True,
                plugins=candidate.registry,
            )
            for _ in range(2)
        ]
    first, second = results
    if (first.wins, first.ties, first.mean_length) != (second.wins, second.ties, second.mean_length):
        raise candidate.broken("play", "the same seed gave two scores")
    return first
