"""Recurrent networks of torch that keep their state in buffers, as rsl_rl exports LSTMs to TorchScript."""

from __future__ import annotations

from contextlib import suppress
from operator import attrgetter
from typing import Any

import torch
from torch import Tensor

from apil_core.api.game import SideLayout
from apil_core.common.errors import failures
from apil_core.policies.foreign.batch import Call, State, alike
from apil_core.policies.foreign.network import SIGNATURE_FILE, Signature
from apil_core.policies.foreign.origin import Origin


def state_outside(
    origin: Origin, network: Any, call: Call, signature: Signature, seat: SideLayout | None
) -> tuple[Call, Signature]:
    """``call`` with the buffers it changes as further inputs and outputs, and a signature with these states.

    They are found by calling it twice. Networks that read more than their own observation are not tried.

    Raises:
        VictimError: the buffers do not begin as zeros (1, k), (layers, 1, k) or (k,), or state is elsewhere.
    """
    width = signature.observation_size or (seat.observation_size if seat else None)
    if signature.state or signature.reads != ("observation",) or width is None:
        return call, signature
    if hasattr(network, "reset"):
        network.reset()
    before = {name: part.clone() for name, part in network.named_buffers()}
    trial = torch.randn(1, width, generator=torch.Generator().manual_seed(0))
    answers: list[list[Tensor]] = []
    with torch.no_grad(), torch.random.fork_rng(devices=[]):
        for one in (trial, trial, trial[0], trial[0]):
            torch.manual_seed(0)
            for name, part in before.items():
                _put(network, name, part)
            with suppress(*failures()):  # why it fails is said where it plays
                answer = call([one])
                parts = [answer] if isinstance(answer, Tensor) else answer
                answers.append([part for part in parts if isinstance(part, Tensor)])
            if len(answers) == 2:
                break
    after = {name: part.nan_to_num() for name, part in network.named_buffers()}
    changed = {n: part for n, part in before.items() if not torch.equal(part.nan_to_num(), after[n])}
    if not all(map(_is_state, changed.values())) or (answers and not alike(answers[0], answers[-1])):
        raise origin.wrong(
            f'its state as inputs and outputs of forward ("state" in its {SIGNATURE_FILE}), or in buffers of '
            "zeros, (1, k) or (layers, 1, k)",
            f"state that calls change in {', '.join(changed) or 'other attributes'}",
        )
    if not changed:
        return call, signature
    shapes: list[State] = [
        (part.shape[0], part.shape[2]) if part.dim() == 3 else part.shape[-1] for part in changed.values()
    ]

    def outside(inputs: list[Tensor]) -> list[Tensor]:
        given, *states = inputs
        for name, state in zip(changed, states, strict=True):
            _put(network, name, state)
        answer = call([given])
        buffers = dict(network.named_buffers())
        return [*([answer] if isinstance(answer, Tensor) else answer), *(buffers[name] for name in changed)]

    return outside, signature.model_copy(update={"state": tuple(shapes)})


def _is_state(part: Tensor) -> bool:
    """True for float32 zeros (1, k), (layers, 1, k) or (k,)."""
    one_game = part.dim() == 1 or (part.dim() in (2, 3) and part.shape[-2] == 1)
    return one_game and part.dtype == torch.float32 and not part.any()


def _put(network: Any, name: str, value: Tensor) -> None:
    """Replace a buffer by a copy, into which the network may write."""
    module, _, buffer = name.rpartition(".")
    setattr(attrgetter(module)(network) if module else network, buffer, value.clone())
