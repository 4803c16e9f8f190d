"""``torch-export:FILE.pt2``: a network saved with ``torch.export.save``.

torch's own loader unpickles parts of such a file, evaluates its size expressions and compiles names from
it into Python. It therefore does not read the original file, but an archive rebuilt from the graph, checked
against the needs of a network of tensor operators, and the raw bytes of the weights.
"""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterator, Mapping
from keyword import iskeyword
from typing import Any

import torch

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy
from apil_core.common.errors import reason_of
from apil_core.policies.foreign.archive import read_archive, rebuilt
from apil_core.policies.foreign.batch import check_shape, states_in
from apil_core.policies.foreign.network import SIGNATURE_FILE, NetworkPolicy, Signature
from apil_core.policies.foreign.origin import Origin
from apil_core.policies.foreign.state_inside import state_outside

KIND = "an archive of torch.export.save"

_MODEL = "models/model.json"
_PAYLOADS = ("data/weights/model_weights_config.json", "data/constants/model_constants_config.json")
_COPIED = ("archive_format", "archive_version")
_DROPPED = ("metadata", "guards_code", "stack_trace")
"""Keys that only debugging tools read; one of them is code."""

_WORD = re.compile(r"[\w.+]*")
_TARGET = re.compile(
    r"torch\.ops\.aten\.(?!(?:from_file|save|__\w*)\.)\w+\.[A-Za-z]\w*|_operator\.(?:getitem|add|sub|mul|floordiv)"
)
_SIZE = re.compile(r"[\w ,()+*='-]*")
_SIZE_WORDS = frozenset(("Symbol", "Integer", "Add", "Mul", "FloorDiv", "Mod", "Max", "Min"))
_SIZE_FLAGS = frozenset(("positive", "nonnegative", "integer", "True", "False"))
_NESTING = frozenset((None, "builtins.tuple", "builtins.list", "builtins.dict"))


def load(name: str, *, seat: SideLayout | None) -> Policy:
    """The network in that file; see :mod:`apil_core.policies.foreign.network` for what it takes and gives.

    Raises:
        VictimError: there is no such file, it is no such archive, its number of games is fixed to more than
            one, or it holds what a network of tensor operators does not need.
    """
    origin = Origin.of("torch-export", name)
    content = read_archive(origin, KIND)
    if _MODEL not in content or any(part not in content for part in _PAYLOADS):
        raise origin.wrong(f"{KIND} with one model", "an archive without it")
    signature = Signature.read(content.get(f"extra/{SIGNATURE_FILE}"), origin.name)
    graph, shapes = _graph(origin, content)
    if not signature.state:
        signature = signature.model_copy(update={"state": states_in(shapes[len(signature.reads) :])})
    network = _open(origin, rebuilt({_MODEL: graph, **_payloads(origin, content)}))

    def call(inputs: list[torch.Tensor]) -> Any:
        return network(*inputs)

    outside, signature = state_outside(origin, network, call, signature, seat)
    return NetworkPolicy(origin, outside, signature, seat, move=network.to, alone=outside)


def _graph(origin: Origin, content: Mapping[str, bytes]) -> tuple[bytes, list[list[Any]]]:
    """The graph as JSON, checked, and the shapes of its inputs."""
    parsed = _parsed(origin, content, _MODEL)
    try:
        graph = _without(parsed, _DROPPED)
        for place, key, value in _strings(graph):
            if not _harmless(key, value):
                raise origin.wrong("a network of tensor operators", f"{value[:80]!r} at {place} of {_MODEL}")
        return json.dumps(graph).encode(), _shapes(origin, graph)
    except RecursionError as error:
        raise origin.wrong(f"a network of tensor operators in {_MODEL}", "JSON nested too deeply") from error


def _parsed(origin: Origin, content: Mapping[str, bytes], part: str) -> Any:
    try:
        return json.loads(content[part])
    except (ValueError, RecursionError) as error:
        raise origin.wrong(f"JSON in {part}", reason_of(error)) from error


def _without(value: Any, keys: tuple[str, ...]) -> Any:
    """A copy in which the values of these keys are empty."""
    if isinstance(value, dict):
        return {k: type(v)() if k in keys and v else _without(v, keys) for k, v in value.items()}
    return [_without(item, keys) for item in value] if isinstance(value, list) else value


def _strings(value: Any, key: str = "", place: str = "") -> Iterator[tuple[str, str, str]]:
    """Every string in nested data, keys included: its path, the key it belongs to, and the string."""
    if isinstance(value, str):
        yield place, key, value
    elif isinstance(value, dict):
        for name, item in value.items():
            yield place, "", name
            yield from _strings(item, name, f"{place}/{name}")
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from _strings(item, key, f"{place}/{number}")


def _harmless(key: str, value: str) -> bool:
    """True if a string under ``key`` is a valid value of that key."""
    if key == "as_string":  # an operator's argument: never more than a text
        return True
    if key in ("target", "as_operator"):
        return _TARGET.fullmatch(value) is not None
    if key == "expr_str":
        return _is_size(value)
    if key in ("in_spec", "out_spec"):
        return _is_nesting(value)
    if key in ("name", "forward_arg_names"):  # these become names in generated Python
        return value == "" or (value.isidentifier() and not iskeyword(value) and not value.startswith("__"))
    hidden = any(part.startswith("__") for part in value.split("."))  # Python's special attributes
    return _WORD.fullmatch(value) is not None and not hidden


def _is_size(text: str) -> bool:
    words = re.findall(r"[A-Za-z_]\w*", text)
    symbols = set(re.findall(r"'(\w+)'", text))
    known = _SIZE_WORDS | _SIZE_FLAGS | {word for word in symbols if re.fullmatch(r"[su]\d+", word)}
    return _SIZE.fullmatch(text) is not None and "**" not in text and all(word in known for word in words)


def _is_nesting(text: str) -> bool:
    """Tuples, lists and dicts of inputs, with names for the dicts' keys and nothing else."""

    def plain(spec: Any) -> bool:
        names = (json.loads(spec["context"]) if spec["context"] else None) or []
        plain_names = isinstance(names, list) and all(str(name).isidentifier() for name in names)
        return plain_names and spec["type"] in _NESTING and all(map(plain, spec["children_spec"]))

    try:
        version, spec = json.loads(text)
        return version == 1 and plain(spec)
    except (ValueError, TypeError, KeyError, RecursionError):
        return False


def _shapes(origin: Origin, graph: Any) -> list[list[Any]]:
    """Shapes of the network's inputs; a size that is free is no int."""
    try:
        inside = graph["graph_module"]
        specs = [spec["user_input"] for spec in inside["signature"]["input_specs"] if "user_input" in spec]
        names = [spec["arg"]["as_tensor"]["name"] for spec in specs]
        values = [inside["graph"]["tensor_values"][name]["sizes"] for name in names]
        shapes = [[dict(size).get("as_int") for size in sizes] for sizes in values]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise origin.wrong("a network that takes tensors (n, k)", reason_of(error)) from error
    for name, shape in zip(names, shapes, strict=True):
        remedy = "torch.export.export(…, dynamic_shapes=({0: torch.export.Dim('n')},))"
        check_shape(origin, name, shape, remedy)
    return shapes


def _payloads(origin: Origin, content: Mapping[str, bytes]) -> dict[str, bytes]:
    """The weights: their lists, and the raw bytes that the lists name."""
    kept = {name: content[name] for name in _COPIED if name in content}
    for part in _PAYLOADS:
        payload = _parsed(origin, content, part)
        listed = payload.get("config", {}) if isinstance(payload, dict) else None
        if not isinstance(listed, dict) or not all(isinstance(entry, dict) for entry in listed.values()):
            raise origin.wrong(f"a JSON object of tensors as 'config' in {part}", "something else")
        for name, entry in listed.items():
            path = str(entry.get("path_name"))
            if entry.get("use_pickle") is not False or not re.fullmatch(r"(weight|tensor)_\d+", path):
                raise origin.wrong(
                    "tensors as raw bytes", f"a pickle or another object for {name!r} in {part}"
                )
            file = f"{part.rpartition('/')[0]}/{path}"
            if file not in content:
                raise origin.wrong(f"{file} in it", "no such part")
            kept[file] = content[file]
        kept[part] = content[part]
    return {**kept, "data/sample_inputs/model.pt": b""}


def _open(origin: Origin, archive: Any) -> torch.nn.Module:
    log = logging.getLogger("torch.export")
    level = log.level
    log.setLevel(logging.CRITICAL)  # it prints tracebacks of exceptions it then raises
    try:
        return torch.export.load(archive).module(check_guards=False)
    except Exception as error:
        raise origin.wrong(KIND, reason_of(error)) from error
    finally:
        log.setLevel(level)
