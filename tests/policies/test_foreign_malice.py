"""A pickle that creates a file for whoever unpickles it, in every place a victim's file has: nobody does."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from apil_core import VictimError, load_policy
from apil_core.policies.zoo import import_zoo
from apil_core.policies.zoo_import import ZooImportError
from policies.foreign_files import Attack, Plain, malicious, save, seat


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    """The file that must not come to be; unpickling does make it."""
    path = tmp_path / "owned"
    torch.load(io.BytesIO(_torch_file(path)), weights_only=False)
    assert path.exists()
    path.unlink()
    return path


def _torch_file(mark: Path) -> bytes:
    buffer = io.BytesIO()
    torch.save(Attack(mark), buffer)
    return buffer.getvalue()


def _repacked(source: Path, target: Path, change: Callable[[str, bytes], bytes]) -> None:
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            new.writestr(name, change(name, old.read(name)))


def _refused(name: str, mark: Path, expected: str) -> None:
    with pytest.raises(VictimError, match=expected) as caught:
        load_policy(name, seat=seat())
    assert "\n" not in str(caught.value)
    assert not mark.exists()


@pytest.mark.parametrize("scheme", ["torchscript", "torch-export", "onnx", "sb3", "safetensors"])
def test_a_bare_pickle(tmp_path: Path, mark: Path, scheme: str) -> None:
    for number, content in enumerate((malicious(mark), _torch_file(mark))):
        file = tmp_path / f"bad{number}"
        file.write_bytes(content)
        _refused(f"{scheme}:{file}", mark, rf"^{scheme}:{file}: expected .*, found ")


@pytest.mark.parametrize("entry", ["data.pkl", "constants.pkl"])
def test_in_a_torchscript_archive(tmp_path: Path, mark: Path, entry: str) -> None:
    save(Plain(), tmp_path / "good.pt")
    bad = tmp_path / "bad.pt"
    _repacked(tmp_path / "good.pt", bad, lambda name, data: malicious(mark) if name.endswith(entry) else data)
    _refused(f"torchscript:{bad}", mark, "expected a TorchScript archive .*, found RuntimeError")


class Writes(nn.Module):
    def forward(self, observation: Tensor) -> Tensor:
        torch.save(observation, "owned.pt")
        return observation[:, :2]


def test_torchscript_that_writes_a_file(tmp_path: Path, mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    name = save(Writes(), tmp_path / "net.pt")
    _refused(name, tmp_path / "owned.pt", r"expected operators on tensors only, found 'save' in code/")


def _with_graph(source: Path, target: Path, change: Callable[[dict], None]) -> None:  # type: ignore[type-arg]
    def changed(name: str, data: bytes) -> bytes:
        if not name.endswith("models/model.json"):
            return data
        graph = json.loads(data)
        change(graph)
        return json.dumps(graph).encode()

    _repacked(source, target, changed)


def test_in_a_torch_export_archive(tmp_path: Path, mark: Path) -> None:
    save(Plain(), tmp_path / "good.pt2")
    bad = tmp_path / "bad.pt2"

    def weights(name: str, data: bytes) -> bytes:
        if name.endswith("weights/weight_0"):
            return _torch_file(mark)
        return data.replace(b'"use_pickle": false', b'"use_pickle": true') if name.endswith("json") else data

    _repacked(tmp_path / "good.pt2", bad, weights)
    _refused(f"torch-export:{bad}", mark, "expected tensors as raw bytes, found a pickle or another object")

    def opaque(name: str, data: bytes) -> bytes:
        if not name.endswith("model_constants_config.json"):
            return data
        entry = {"path_name": "opaque_obj_0", "is_param": False, "use_pickle": False, "tensor_meta": None}
        return json.dumps({"config": {"x": entry}}).encode()

    _repacked(tmp_path / "good.pt2", bad, opaque)
    _refused(f"torch-export:{bad}", mark, "expected tensors as raw bytes, found a pickle or another object")


def test_sample_inputs_of_a_torch_export_archive_are_not_read(tmp_path: Path, mark: Path) -> None:
    save(Plain(), tmp_path / "good.pt2")
    bad = tmp_path / "bad.pt2"
    _repacked(
        tmp_path / "good.pt2",
        bad,
        lambda name, data: _torch_file(mark) if "sample_inputs" in name else data,
    )
    with suppress(Exception):
        torch.export.load(bad)
    assert mark.exists(), "torch's own loader runs it, or this test shows nothing"
    mark.unlink()
    load_policy(f"torch-export:{bad}", seat=seat())
    assert not mark.exists()


def test_code_in_a_torch_export_archive(tmp_path: Path, mark: Path) -> None:
    save(Plain(), tmp_path / "good.pt2")
    bad = tmp_path / "bad.pt2"
    code = f"__import__('os').system('touch {mark}')"

    def size(graph: dict) -> None:  # type: ignore[type-arg]
        inputs = graph["graph_module"]["graph"]["tensor_values"]["observation"]
        inputs["sizes"][0]["as_expr"]["expr_str"] = code

    def target(graph: dict) -> None:  # type: ignore[type-arg]
        graph["graph_module"]["graph"]["nodes"][0]["target"] = "torch.os.system"

    def name(graph: dict) -> None:  # type: ignore[type-arg]
        graph["graph_module"]["graph"]["nodes"][0]["name"] = f"x = {code}; y"

    def operator(graph: dict) -> None:  # type: ignore[type-arg]
        graph["graph_module"]["graph"]["nodes"][0]["target"] = "torch.ops.aten.from_file.default"

    def parameter(graph: dict) -> None:  # type: ignore[type-arg]
        spec = graph["graph_module"]["signature"]["input_specs"][0]["parameter"]
        spec["parameter_name"] = "__class__.forward"

    def nesting(graph: dict) -> None:  # type: ignore[type-arg]
        signature = graph["graph_module"]["module_call_graph"][0]["signature"]
        context = json.dumps({"__enum__": True, "fqn": "antigravity:x", "name": "x"})
        signature["in_spec"] = json.dumps(
            [1, {"type": "builtins.dict", "context": context, "children_spec": []}]
        )

    for change in (size, target, name, operator, parameter, nesting):
        _with_graph(tmp_path / "good.pt2", bad, change)
        _refused(f"torch-export:{bad}", mark, "expected a network of tensor operators, found ")


@pytest.mark.parametrize(
    ("part", "content"),
    [
        ("models/model.json", b"[]"),
        ("models/model.json", b"[" * 100_000),
        ("models/model.json", b"[" * 900 + b"]" * 900),
        ("model_weights_config.json", b"[]"),
        ("model_weights_config.json", b'{"config": []}'),
        ("model_weights_config.json", b'{"config": {"x": []}}'),
        ("model_weights_config.json", b"[" * 100_000),
    ],
)
def test_json_of_another_shape_in_a_torch_export_archive(
    tmp_path: Path, mark: Path, part: str, content: bytes
) -> None:
    save(Plain(), tmp_path / "good.pt2")
    bad = tmp_path / "bad.pt2"
    _repacked(tmp_path / "good.pt2", bad, lambda name, data: content if name.endswith(part) else data)
    _refused(f"torch-export:{bad}", mark, rf"^torch-export:{bad}: expected .*{part}.*, found |takes tensors")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"policy_kwargs": [1]}, "expected a JSON object as policy_kwargs, found a list"),
        (
            {"policy_kwargs": {"activation_fn": "functools.partial(<class 'torch.nn.LeakyReLU'>, 0.2)"}},
            r"expected the name of a class as policy_kwargs\['activation_fn'\], found \"functools\.partial",
        ),
        ({"policy_kwargs": {"activation_fn": None}}, r"as policy_kwargs\['activation_fn'\], found None"),
    ],
)
def test_facts_of_stable_baselines_that_cannot_be_read(
    tmp_path: Path, mark: Path, change: dict[str, object], expected: str
) -> None:
    _refused(_sb3(tmp_path / "bad.zip", {**DATA, **change}, _weights()), mark, expected)


def test_data_of_stable_baselines_that_is_too_deep(tmp_path: Path, mark: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        archive.writestr("data", "[" * 100_000)
        archive.writestr("policy.pth", _weights())
    _refused(f"sb3:{tmp_path}/bad.zip", mark, "expected a zip of Stable-Baselines3 .*, found RecursionError")


def test_guards_of_a_torch_export_archive_are_not_run(tmp_path: Path, mark: Path) -> None:
    save(Plain(), tmp_path / "good.pt2")
    bad = tmp_path / "bad.pt2"
    code = f"__import__('os').system('touch {mark}')"
    _with_graph(tmp_path / "good.pt2", bad, lambda graph: graph.update(guards_code=[code]))
    load_policy(f"torch-export:{bad}", seat=seat())
    assert not mark.exists()


def test_two_files_of_one_name_in_an_archive(tmp_path: Path, mark: Path) -> None:
    save(Plain(), tmp_path / "net.pt")
    with zipfile.ZipFile(tmp_path / "net.pt", "a") as archive:
        folder = archive.namelist()[0].partition("/")[0]
        archive.writestr(f"{folder}/DATA.pkl", malicious(mark))
    _refused(f"torchscript:{tmp_path}/net.pt", mark, "one folder of distinct files")


BOX = {":type:": "<class 'gymnasium.spaces.box.Box'>"}
DATA = {
    "policy_class": {"__module__": "stable_baselines3.common.policies"},
    "policy_kwargs": {},
    "use_sde": False,
    "observation_space": {**BOX, "_shape": [7], "low": "[-inf]", "high": "[inf]"},
    "action_space": {**BOX, "_shape": [2], "low": "[-1. -1.]", "high": "[1. 1.]"},
}


def _sb3(path: Path, data: dict[str, object], weights: bytes) -> str:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps(data))
        archive.writestr("policy.pth", weights)
    return f"sb3:{path}"


def _weights() -> bytes:
    buffer = io.BytesIO()
    torch.save(
        {
            "log_std": torch.zeros(2),
            "mlp_extractor.policy_net.0.weight": torch.ones(4, 7),
            "mlp_extractor.policy_net.0.bias": torch.zeros(4),
            "action_net.weight": torch.ones(2, 4),
            "action_net.bias": torch.zeros(2),
        },
        buffer,
    )
    return buffer.getvalue()


def test_in_the_weights_of_stable_baselines(tmp_path: Path, mark: Path) -> None:
    for content in (malicious(mark), _torch_file(mark)):
        name = _sb3(tmp_path / "bad.zip", DATA, content)
        _refused(name, mark, r"bad\.zip: expected policy\.pth with tensors only, found UnpicklingError")


def test_in_the_data_of_stable_baselines(tmp_path: Path, mark: Path) -> None:
    pickled = base64.b64encode(malicious(mark)).decode()
    space = {**DATA["action_space"], ":serialized:": pickled}  # type: ignore[dict-item]
    data = {**DATA, "action_space": space, "lr_schedule": {":type:": "x", ":serialized:": pickled}}
    policy = load_policy(_sb3(tmp_path / "agent.zip", data, _weights()))
    assert (policy.info.observation_size, policy.info.action_size) == (7, 2)
    assert not mark.exists()


def test_in_the_zoo(made_up_zoo: Path, mark: Path) -> None:
    agent = next(made_up_zoo.rglob("*.pkl"))
    agent.write_bytes(malicious(mark))
    with pytest.raises(ZooImportError, match="SHA-256"):
        import_zoo(made_up_zoo)
    assert not mark.exists()
