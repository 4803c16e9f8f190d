"""A third-party network as a policy: one calling convention for TorchScript, torch.export, ONNX and Python.

A network takes its inputs, then its states, and returns its action, then its new states::

    forward(observation, *states) -> (action, *states)
    forward(observation, *states) -> (mean, log_std, *states)

All float32: observation (n, o), action and mean (n, a), log_std (a,) or (n, a), each state (n, k) or
(layers, n, k). A choice among k actions may be an integer, (n,). Of (action, value (n, 1), log_prob (n,)),
which Stable-Baselines3's recipe exports, the action counts. With one action, a second output (n, 1) that
depends on the observation may be a value as well: it is refused unless the :class:`Signature` gives
``log_std``. States are zero where a game starts. Deviations from
``forward(observation)`` are declared by a :class:`Signature`, JSON stored in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import prod
from typing import Annotated, Any, Literal

import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from torch import Tensor

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.common.errors import ApilError, VictimError, failures, reason_of
from apil_core.policies.foreign.batch import Batch, Call, State
from apil_core.policies.foreign.origin import Origin
from apil_core.policies.recurrent_state import Memory

SIGNATURE_FILE = "apil.json"
"""Name of the signature in archives, and its key in ONNX's metadata."""

Reads = Literal["observation", "opponent", "opponent_action", "first"]


class Signature(BaseModel):
    """Metadata in a network's file; every key may be missing.

    Attributes:
        reads: inputs before the states, in order: ``observation``, ``opponent`` (the other side's),
            ``opponent_action`` (only for the second mover), ``first`` (n, 1): 1 where a game starts.
        gives: outputs before the states, where they would be ambiguous.
        state: of each state the width, or layers and width.
        observation_size, action_size: of the side it plays.
        action_bounds: lowest and highest action; a seat must have the same.
        provenance: origin, as text.
    """

    model_config = ConfigDict(extra="forbid", ser_json_inf_nan="constants")

    reads: Annotated[tuple[Reads, ...], Field(min_length=1)] = ("observation",)
    gives: tuple[Literal["mean"], Literal["log_std"]] | None = None
    state: tuple[State, ...] = ()
    observation_size: int | None = Field(default=None, gt=0)
    action_size: int | None = Field(default=None, gt=0)
    action_bounds: tuple[float, float] | None = None
    provenance: dict[str, str] = {}

    @classmethod
    def read(cls, text: str | bytes | None, name: str) -> Signature:
        """Parse the JSON in a file; if there is none, every key is missing.

        Raises:
            VictimError: it is no valid signature.
        """
        try:
            return cls() if not text else cls.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"]))
            raise VictimError(f"{name}: its {SIGNATURE_FILE} is wrong: {key}: {first['msg']}") from None


def refuse_values(name: str, outputs: Sequence[str], states: int) -> None:
    """Refuse a network with an output that is called a value, unless it is one of three before the states.

    Raises:
        VictimError: there is one.
    """
    for output in outputs:
        if "value" in output.lower() and len(outputs) - states != 3:
            raise VictimError(f"{name}: expected an action, or mean and log_std, found an output {output!r}")


class NetworkPolicy(Policy):
    """A policy that calls a network. Unspecified parts of the signature are inferred from one call.

    Args:
        origin: name and hash.
        call: the network, on the CPU, for any number of games.
        signature: its inputs and states.
        seat: of the policy; gives the sizes if the network does not state its own.
        move: moves the network to a device; ``None``: it stays on the CPU, and tensors are copied.
        alone: the network for one game, where ``call`` may not take several: see :class:`Batch`.

    Raises:
        VictimError: it cannot be called with its seat's observations, or does not return actions.
    """

    def __init__(
        self,
        origin: Origin,
        call: Call,
        signature: Signature,
        seat: SideLayout | None,
        move: Callable[[torch.device], object] | None = None,
        alone: Call | None = None,
    ):
        self.signature = signature
        self.batch = Batch(self._ask, call, alone, len(signature.reads), signature.state)
        self._choices = seat.action_size if seat and seat.discrete else 0
        self._move = move
        self._device = self._home = torch.device("cpu")  # of the network; of views and states
        self._memory = Memory(origin.name)
        self._widths = {
            f"state_{i}": prod(k) if isinstance(k, tuple) else k for i, k in enumerate(signature.state)
        }
        observations = signature.observation_size or (seat.observation_size if seat else None)
        if observations is None:
            raise VictimError(f"{origin.name} does not state its sizes: say which seat it is for (seat=…)")
        self.info = PolicyInfo(
            name=origin.name,
            sha256=origin.sha256,
            observation_size=observations,
            action_size=0,
            provenance=signature.provenance,
            action_bounds=signature.action_bounds,
        )
        self.info = replace(self.info, action_size=signature.action_size or self._action_size())

    def _action_size(self) -> int:
        """Infer it from two actions."""
        unstated = [name for name in self.signature.reads if name.startswith("opponent")]
        if unstated:
            raise VictimError(
                f"{self.info.name}: it reads {unstated[0]}, so its {SIGNATURE_FILE} must state action_size"
            )
        own = torch.zeros(2, self.info.observation_size)
        shape = self.act(View(own, own, torch.ones(2, dtype=torch.bool)), sample=False).action.shape
        self._memory.rows = {}
        if len(shape) != 2 or shape[0] != 2:
            raise VictimError(f"{self.info.name}: expected actions (2, a) for two games, got {tuple(shape)}")
        return shape[1]

    @torch.no_grad()
    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; hidden layers are not known."""
        state = self._memory.begin(view.first, partial(self._start, view.own.device)) if self._widths else {}
        inputs = [self._input(name, view) for name in self.signature.reads]
        outputs = self.batch([tensor.to(self._device) for tensor in [*inputs, *state.values()]])
        outputs = [output.to(view.own.device) for output in outputs]
        count = len(outputs) - len(state)
        self._memory.rows = dict(zip(state, outputs[count:], strict=True))
        if self._choices and not outputs[0].is_floating_point():
            outputs[0] = self._scores(outputs[0])
        layers: dict[str, Tensor] | None = {} if activations else None
        if count == 1:
            return Decision(outputs[0], None, layers)
        if (
            outputs[1].shape[1:] == (1,)
            and not self.signature.gives
            and bool((outputs[1] != outputs[1][:1]).any())
        ):
            raise VictimError(
                f"{self.info.name}: its second output depends on the observation: give the action alone if it"
                f' is a value; if it is log_std, say so in {SIGNATURE_FILE}: {{"gives": ["mean", "log_std"]}}'
            )
        distribution = DiagonalGaussian(outputs[0], outputs[1].exp())
        return Decision(distribution.sample(generator) if sample else outputs[0], distribution, layers)

    def _input(self, name: str, view: View) -> Tensor:
        if name == "observation":
            return view.own
        if name == "first":
            return view.first.to(view.own.dtype).unsqueeze(1)
        value = view.opponent if name == "opponent" else view.opponent_action
        if value is None:
            raise VictimError(f"{self.info.name} reads its opponent's action, so it must act second")
        return value

    def _start(self, device: torch.device, games: int) -> dict[str, Tensor]:
        return {name: torch.zeros(games, width, device=device) for name, width in self._widths.items()}

    def _scores(self, choice: Tensor) -> Tensor:
        """Scores (n, k) of a choice (n, 1): 1 for it, 0 for the others."""
        scores = (choice == torch.arange(self._choices, device=choice.device)).float()
        if not scores.any(1).all():
            raise VictimError(
                f"{self.info.name}: expected one of {self._choices} choices, got {choice.max()}"
            )
        return scores

    def _ask(self, call: Call, inputs: list[Tensor]) -> list[Tensor]:
        """The checked outputs of one call."""
        try:
            answer = call(inputs)
        except ApilError:
            raise
        except failures() as error:  # any exception of the network's runtime
            shapes = ", ".join(str(tuple(tensor.shape)) for tensor in inputs)
            raise VictimError(f"{self.info.name} fails on inputs {shapes}: {reason_of(error)}") from error
        outputs = [answer] if isinstance(answer, Tensor) else answer
        states = len(self.signature.state)
        refuse_values(self.info.name, getattr(answer, "_fields", ()), states)
        right = isinstance(outputs, (list, tuple)) and all(isinstance(part, Tensor) for part in outputs)
        if right and len(outputs) - states == 3 and not self.signature.gives:
            _, value, log_prob, *rest = outputs
            if value.shape == (*log_prob.shape, 1):
                outputs = [outputs[0], *rest]
        if not right or len(outputs) - states not in (1, 2):
            got = f"{len(outputs)}" if right else type(answer).__name__
            raise VictimError(
                f"{self.info.name}: expected an action, or mean and log_std, and then {states} states, "
                f"all tensors; got {got}"
            )
        return list(outputs)

    def to(self, device: torch.device | str) -> NetworkPolicy:
        """Move the network, if it can be moved, and its state."""
        if self._move is not None:
            self._device = torch.device(device)
            self._move(self._device)
        self._home = torch.device(device)
        self.load_recurrent_state(self.recurrent_state())
        return self

    def recurrent_state(self) -> dict[str, Any]:
        """``state_0`` and so on, each (n, k)."""
        return dict(self._memory.rows)

    def load_recurrent_state(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`recurrent_state`; an empty one resets all games."""
        self._memory.load(state, self._home)
