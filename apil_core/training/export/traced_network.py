"""A trained adversary as a fixed network of tensor operators, traced by torch."""

from __future__ import annotations

import io
import logging
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, get_args

import torch
from torch import Tensor, nn

from apil_core.api.game import SideLayout
from apil_core.api.method import RunPlugin
from apil_core.api.types import View
from apil_core.common.errors import ApilError, reason_of
from apil_core.policies.foreign.archive import rebuilt
from apil_core.policies.foreign.network import SIGNATURE_FILE, Reads, Signature
from apil_core.training.adversary import AdversaryPolicy

OPSET = 20
INPUTS: tuple[Reads, ...] = get_args(Reads)
_OUTPUTS = ("mean", "log_std")


class _Whole(nn.Module):
    """An adversary as a module: its inputs to mean (n, a) and log standard deviation (a,)."""

    def __init__(self, policy: AdversaryPolicy):
        super().__init__()
        self.actor = policy.actor
        self.normalizers = policy.builder.normalizers
        # so that tracing treats the plugins' weights as parameters
        for name, plugin in policy.hooks.of(RunPlugin).items():
            for key, part in vars(plugin).items():
                if isinstance(part, nn.Module):
                    self.add_module(f"{name}_{key}", part)
        self._policy = policy

    def forward(self, *inputs: Tensor) -> tuple[Tensor, Tensor]:
        """``inputs`` as in :data:`INPUTS`."""
        own, opponent, opponent_action, first = inputs
        view = View(own, opponent, first[:, 0] > 0.5, opponent_action)
        groups = self._policy.builder.unchecked_groups(self._policy.context, view)
        normalized = {name: self.normalizers[name](value) for name, value in groups.items()}
        distribution = self.actor(normalized)
        return distribution.mean, distribution.std.log()


class _Reading(nn.Module):
    """Wrapper of a network that takes only the inputs in the signature; the others are zeros."""

    def __init__(self, whole: nn.Module, reads: tuple[Reads, ...], widths: tuple[int, ...]):
        super().__init__()
        self.whole = whole
        self._reads = reads
        self._widths = widths

    def forward(self, *inputs: Tensor) -> tuple[Tensor, Tensor]:
        """``inputs`` as in the signature's ``reads``."""
        given = dict(zip(self._reads, inputs, strict=True))
        some = inputs[0][:, :1]  # for the number of games
        everything = [
            given[name] if name in given else some * torch.zeros(1, width)
            for name, width in zip(INPUTS, self._widths, strict=True)
        ]
        result: tuple[Tensor, Tensor] = self.whole(*everything)
        return result


@dataclass(frozen=True)
class Traced:
    """An adversary as a network.

    Attributes:
        network: takes ``signature.reads``, returns mean and log standard deviation.
        signature: written to the file.
        inputs: an example, two games.
    """

    network: nn.Module
    signature: Signature
    inputs: tuple[Tensor, ...]


def trace(policy: AdversaryPolicy, seat: SideLayout, view: View, provenance: Mapping[str, str]) -> Traced:
    """Determine the inputs of an adversary, and wrap it to take only those.

    Args:
        policy: on the CPU.
        seat: of the adversary.
        view: an example; at least two games.
        provenance: stored in the file.

    Raises:
        ApilError: its methods' hooks do more than tensor operators on their view.
    """
    assert view.opponent_action is not None
    two = slice(0, 2)
    first = view.first.to(torch.float32).unsqueeze(1)
    examples = tuple(part[two] for part in (view.own, view.opponent, view.opponent_action, first))
    whole = _Whole(policy).eval()
    program = _program(whole, examples)
    names = [spec.arg.name for spec in program.graph_signature.input_specs if spec.kind.name == "USER_INPUT"]
    program.graph.eliminate_dead_code()
    used = {node.name for node in program.graph.nodes if node.op == "placeholder" and node.users}
    reads = tuple(kind for kind, name in zip(INPUTS, names, strict=True) if name in used)
    signature = Signature(
        reads=reads,
        observation_size=seat.observation_size,
        action_size=seat.action_size,
        action_bounds=(seat.action_low, seat.action_high),
        provenance=dict(provenance),
    )
    network = _Reading(whole, reads, tuple(example.shape[1] for example in examples)).eval()
    return Traced(network, signature, tuple(e for k, e in zip(INPUTS, examples, strict=True) if k in reads))


def torchscript_bytes(traced: Traced) -> bytes:
    """A TorchScript archive with the signature in it.

    Raises:
        ApilError: torch cannot trace it.
    """
    buffer = io.BytesIO()
    try:
        with _quiet(), torch.no_grad():
            script = torch.jit.trace(traced.network, traced.inputs, check_trace=False)
            script = torch.jit.freeze(script.eval())
            torch.jit.save(script, buffer, _extra_files={SIGNATURE_FILE: traced.signature.model_dump_json()})
        return _without_places(buffer)
    except Exception as error:
        raise _untraceable(error) from error


def _without_places(archive: io.BytesIO) -> bytes:
    """The archive without its debug tracebacks, which name files of this machine."""
    with zipfile.ZipFile(archive) as read:
        content = {name.partition("/")[2]: read.read(name) for name in read.namelist()}
    version = int(content["version"])
    written_anew = ("version", "byteorder", ".data/")
    kept = {
        name: data
        for name, data in content.items()
        if not name.startswith(written_anew) and not name.endswith(".debug_pkl")
    }
    return rebuilt(kept, version).getvalue()


def onnx_bytes(traced: Traced) -> bytes:
    """An ONNX model with the signature in its metadata.

    Raises:
        ApilError: torch cannot translate it.
    """
    try:
        with _quiet():
            program = _program(traced.network, traced.inputs)
            onnx = torch.onnx.export(
                program,
                dynamo=True,
                opset_version=OPSET,
                input_names=list(traced.signature.reads),
                output_names=list(_OUTPUTS),
                verbose=False,
            )
            assert onnx is not None
            model = onnx.model_proto
    except ApilError:
        raise
    except Exception as error:
        raise _untraceable(error) from error
    for node in model.graph.node:
        del node.metadata_props[:]  # file names and lines of this machine
    entry = model.metadata_props.add()
    entry.key, entry.value = SIGNATURE_FILE, traced.signature.model_dump_json()
    content: bytes = model.SerializeToString()
    return content


def _program(network: nn.Module, examples: tuple[Tensor, ...]) -> Any:
    games = torch.export.Dim("games")
    try:
        with _quiet(), torch.no_grad():
            # one *args parameter: its shapes come as a tuple in a tuple
            return torch.export.export(network, examples, dynamic_shapes=(({0: games},) * len(examples),))
    except Exception as error:
        raise _untraceable(error) from error


def _untraceable(error: Exception) -> ApilError:
    return ApilError(
        f"this adversary is no fixed network of tensor operators: {reason_of(error)}; "
        "use --format safetensors"
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence torch's warnings and logs while it traces, which users cannot act on."""
    loggers = [logging.getLogger(name) for name in ("torch.export", "torch.onnx", "onnxscript", "onnx_ir")]
    levels = [log.level for log in loggers]
    for log in loggers:
        log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for log, level in zip(loggers, levels, strict=True):
            log.setLevel(level)
