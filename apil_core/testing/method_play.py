"""Checks of a trained adversary outside its run, and blinded. Each raises ContractError."""

from __future__ import annotations

import torch
from torch import Tensor

from apil_core.common.errors import ApilError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.pairing import Pairing, load_pairing
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import score
from apil_core.policies.conformance import check_policy
from apil_core.testing.checks import checking
from apil_core.testing.method_runs import WatchedRun
from apil_core.testing.method_under_test import MethodUnderTest
from apil_core.training.export.export import write
from apil_core.training.export.run_policy import RunCheckpoint

EPISODES, STEPS = 4, 6


@checking("evaluation")
def check_playing(tested: MethodUnderTest, run: WatchedRun) -> None:
    """Check the trained adversary, loaded twice from its run's directory, and blinded.

    As a policy it keeps that contract, too: it can sit in a victim's seat.
    """
    seen = []
    for _ in range(2):
        with (
            load_pairing(run.out, num_envs=EPISODES, threads=1, plugins=tested.registry) as pairing,
            one_torch_thread(),
            pairing.attribution(),
        ):
            seen.append((first_actions(pairing), _outcome(score(pairing, episodes=EPISODES, seed=0))))
            if len(seen) == 1:
                check_blinding(tested, pairing)
    (actions, outcome), (other_actions, other_outcome) = seen
    text = "loaded twice, the trained adversary acts differently with the same seed"
    tested.need(torch.equal(actions, other_actions), text)
    tested.need(outcome == other_outcome, "two evaluations of one seed differ")


@checking("export")
def check_export(tested: MethodUnderTest, run: WatchedRun) -> None:
    """Check it as in ``apil export``; what a network cannot express is listed as not checked."""
    if run.trainer.attack.hooks.implements("filter_observation"):
        tested.skipped.append("export: filter_observation belongs to the run")
        return
    source = RunCheckpoint.find(run.out)
    write(source, "safetensors", run.out / "adversary.safetensors", tested.registry)
    for format in ("torchscript", "onnx"):
        try:
            write(source, format, run.out / f"adversary.{format}", tested.registry)
        except ApilError as error:
            tested.skipped.append(f"export: {format}: {error}")


@checking("blinding")
def check_blinding(tested: MethodUnderTest, pairing: Pairing) -> None:
    """Check it as in ``apil eval --blind initial --blind-imitator``."""
    if not pairing.game.layout.sides[pairing.side].opponent_channels:
        tested.skipped.append(f"blinding: game {tested.env} names no opponent channels")
        return
    score(pairing, episodes=EPISODES, seed=0, blind="initial", blind_imitator=True)


@torch.inference_mode()
def first_actions(pairing: Pairing) -> Tensor:
    """The adversary's actions in the first steps of some games, (STEPS, EPISODES, a)."""
    sides = pairing.game.layout.sides
    check_policy(pairing.adversary, sides[pairing.side], sides[1 - pairing.side], second=True)
    pairing.adversary.seed(0)
    players, game = pairing.players(seed=0), pairing.game
    game.seed(0)
    games, chosen = players.start(game), []
    for _ in range(STEPS):
        actions = players.act(games)
        chosen.append(actions[pairing.side].clone())
        games.reset(games.step(actions).done)
    return torch.stack(chosen)


def _outcome(result: EvaluationResult) -> tuple[object, ...]:
    return result.wins, result.ties, result.losses, result.causes, result.mean_length
