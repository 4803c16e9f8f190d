"""``onnx:FILE``: a network in ONNX, run by onnxruntime on one CPU thread. Needs the extra ``onnx``."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from apil_core.errors import VictimError
from apil_core.extras import need_extra
from apil_core.game import SideLayout
from apil_core.policy import Policy
from apil_core.victims.foreign.network import SIGNATURE_FILE, NetworkPolicy, Signature
from apil_core.victims.foreign.origin import Origin, one_line

KIND = "an ONNX model"


def load(name: str, *, seat: SideLayout | None) -> Policy:
    """The network in that file; see :mod:`apil_core.victims.foreign.network` for what it takes and gives.

    Inputs and outputs count by their order; their names do not matter.

    Raises:
        ApilError: onnxruntime is missing.
        VictimError: there is no such file, it is no ONNX model, or its inputs are not a policy's.
    """
    runtime = need_extra("onnxruntime", "onnx", "ONNX policies")
    origin = _with_weights(Origin.of("onnx", name))
    session = _session(origin, runtime)
    told = session.get_modelmeta().custom_metadata_map
    signature = _checked(origin, session, Signature.read(told.get(SIGNATURE_FILE), origin.name))
    names = [wanted.name for wanted in session.get_inputs()]

    def call(inputs: list[Tensor]) -> list[Tensor]:
        feed = {key: tensor.numpy() for key, tensor in zip(names, inputs, strict=True)}
        return [torch.from_numpy(output) for output in session.run(None, feed)]

    return NetworkPolicy(origin, call, signature, seat)


def _with_weights(origin: Origin) -> Origin:
    """The hash covers the file of weights that exporters lay beside a model."""
    beside = [Path(f"{origin.path}{suffix}") for suffix in (".data", "_data")]
    parts = [path.read_bytes() for path in beside if path.is_file()]
    if not parts:
        return origin
    return replace(origin, sha256=hashlib.sha256(b"".join([origin.path.read_bytes(), *parts])).hexdigest())


def _session(origin: Origin, runtime: Any) -> Any:
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # more would change sums
    options.log_severity_level = 4
    try:
        return runtime.InferenceSession(str(origin.path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has a dozen kinds of its own
        raise origin.wrong(KIND, one_line(error)) from error


def _checked(origin: Origin, session: Any, signature: Signature) -> Signature:
    """``signature`` with the sizes that the model states."""
    inputs = session.get_inputs()
    count = len(signature.reads) + len(signature.state)
    if len(inputs) != count:
        listed = ", ".join(f"{wanted.name} {wanted.shape}" for wanted in inputs)
        raise origin.wrong(
            f"{count} inputs ({SIGNATURE_FILE} in its metadata says what it reads and its states)", listed
        )
    for wanted in inputs:
        if wanted.type != "tensor(float)":
            raise origin.wrong(f"float32 for input {wanted.name!r}", wanted.type)
        if len(wanted.shape) != 2:
            raise origin.wrong(f"shape (n, k) for input {wanted.name!r}", f"{wanted.shape}")
        if isinstance(wanted.shape[0], int):
            raise origin.wrong(
                f"any number of games in input {wanted.name!r} (export it with a dynamic first axis: "
                "torch.onnx.export(…, dynamic_shapes=({0: 'n'},)))",
                f"a fixed {wanted.shape[0]}",
            )
    size = inputs[0].shape[1] if signature.reads[0] == "observation" else None
    if isinstance(size, int) and signature.observation_size in (None, size):
        return signature.model_copy(update={"observation_size": size})
    if isinstance(size, int):
        raise VictimError(f"{origin.name} states {signature.observation_size} observations and takes {size}")
    return signature
