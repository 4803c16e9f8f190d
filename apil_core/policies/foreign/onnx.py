"""``onnx:FILE``: a network in ONNX, run by onnxruntime on one CPU thread. Needs the extra ``onnx``."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import onnx
import torch
from google.protobuf.message import Message
from onnx import ModelProto, TensorProto, numpy_helper
from torch import Tensor

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy
from apil_core.common.errors import VictimError, reason_of
from apil_core.common.extras import need
from apil_core.policies.foreign.batch import Call, check_shape, games_axis, states_in
from apil_core.policies.foreign.network import SIGNATURE_FILE, NetworkPolicy, Signature, refuse_values
from apil_core.policies.foreign.origin import Origin

KIND = "an ONNX model"


def load(name: str, *, seat: SideLayout | None) -> Policy:
    """The network in that file; see :mod:`apil_core.policies.foreign.network` for what it takes and gives.

    Inputs and outputs count by their order; their names do not matter.

    Raises:
        ApilError: onnxruntime is missing.
        VictimError: there is no such file, it is no ONNX model, or its inputs are not a policy's,
            or it takes weights from outside its folder.
    """
    runtime = need("onnxruntime")
    origin = _with_weights(Origin.of("onnx", name))
    session = _session(origin, runtime)
    stated = session.get_modelmeta().custom_metadata_map
    signature = _checked(origin, session, Signature.read(stated.get(SIGNATURE_FILE), origin.name))
    refuse_values(origin.name, [output.name for output in session.get_outputs()], len(signature.state))
    alone = _call(session)
    freed = None
    shapes = [wanted.shape for wanted in session.get_inputs()]
    if any(len(shape) > 1 and shape[games_axis(len(shape))] == 1 for shape in shapes):
        with suppress(Exception):  # a graph whose operators need one game; it is then played one by one
            freed = _call(_session(origin, runtime, _freed(origin)))
    return NetworkPolicy(origin, freed or alone, signature, seat, alone=alone)


def _call(session: Any) -> Call:
    names = [wanted.name for wanted in session.get_inputs()]

    def call(inputs: list[Tensor]) -> list[Tensor]:
        feed = {key: tensor.numpy() for key, tensor in zip(names, inputs, strict=True)}
        return [torch.from_numpy(output) for output in session.run(None, feed)]

    return call


def _freed(origin: Origin) -> bytes:
    """The model with its axis of games free, without the shapes that torch inferred for one game."""
    model = onnx.load(origin.path)
    for value in [*model.graph.input, *model.graph.output]:
        sizes = value.type.tensor_type.shape.dim
        axis = games_axis(len(sizes))
        if len(sizes) > 1 and sizes[axis].dim_value == 1:
            sizes[axis].dim_param = "games"
        elif value in model.graph.output:
            value.type.tensor_type.ClearField("shape")
    del model.graph.value_info[:]
    targets = {node.input[1] for node in model.graph.node if node.op_type == "Reshape"}
    for constant in model.graph.initializer:
        shape = numpy_helper.to_array(constant).copy() if constant.name in targets else np.zeros(0)
        ones = np.flatnonzero(shape == 1)
        if len(ones) and (shape > 0).all():  # of (time, games, k), as torch exports LSTMs, the second
            shape[ones[-1]] = -1
            constant.CopyFrom(numpy_helper.from_array(shape, constant.name))
    content: bytes = model.SerializeToString()
    return content


def _with_weights(origin: Origin) -> Origin:
    """The hash covers every file of weights that the model names; all must be in its folder."""
    content = origin.path.read_bytes()
    try:
        named = sorted(set(_locations(ModelProto.FromString(content))))
    except Exception as error:  # protobuf's own
        raise origin.wrong(KIND, reason_of(error)) from error
    parts = [content]
    for location in named:
        path, folder = (origin.path.parent / location).resolve(), origin.path.parent.resolve()
        if not path.is_relative_to(folder) or not path.is_file():
            raise origin.wrong(f"its weights in a file in {folder}", f"{location!r}: outside, or no file")
        parts.append(path.read_bytes())
    return replace(origin, sha256=hashlib.sha256(b"".join(parts)).hexdigest()) if named else origin


def _locations(message: Message) -> Iterator[str]:
    """External files referenced by tensors in a message; onnx's own helper misses sparse tensors."""
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in [value] if isinstance(value, Message) else value:
                yield from _locations(part)
    if isinstance(message, TensorProto):
        yield from (entry.value for entry in message.external_data if entry.key == "location")


def _session(origin: Origin, runtime: Any, content: bytes | None = None) -> Any:
    """Of the file, or of ``content`` made from it."""
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # more would change sums
    options.log_severity_level = 4
    try:
        return runtime.InferenceSession(
            content or str(origin.path), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime has a dozen exception types
        raise origin.wrong(KIND, reason_of(error)) from error


def _checked(origin: Origin, session: Any, signature: Signature) -> Signature:
    """``signature`` with the sizes and states that the model states."""
    inputs = session.get_inputs()
    if not signature.state:
        states = states_in([wanted.shape for wanted in inputs[len(signature.reads) :]])
        signature = signature.model_copy(update={"state": states})
    count = len(signature.reads) + len(signature.state)
    if len(inputs) != count:
        listed = ", ".join(f"{wanted.name} {wanted.shape}" for wanted in inputs)
        raise origin.wrong(
            f"{count} inputs ({SIGNATURE_FILE} in its metadata says what it reads and its states)", listed
        )
    for wanted in inputs:
        if wanted.type != "tensor(float)":
            raise origin.wrong(f"float32 for input {wanted.name!r}", wanted.type)
        check_shape(origin, wanted.name, wanted.shape, "torch.onnx.export(…, dynamic_shapes=({0: 'n'},))")
    size = inputs[0].shape[-1] if signature.reads[0] == "observation" else None
    if isinstance(size, int) and signature.observation_size in (None, size):
        return signature.model_copy(update={"observation_size": size})
    if isinstance(size, int):
        raise VictimError(f"{origin.name} states {signature.observation_size} observations and takes {size}")
    return signature
