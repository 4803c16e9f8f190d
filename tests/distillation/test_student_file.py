"""A student's file and networks: equal to what was trained, by hand, and refused when damaged."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file as save_tensors

from apil_core import PolicyInfo, VictimError, View
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.network import NetworkShape
from apil_core.policies.student import load_file, save_policy, weights_sha256
from apil_core.runs.distillation.learner import StudentLearner

TINY = NetworkShape("mlp", observation_size=2, action_size=1, width=0, hidden=(), clip=5.0)
WEIGHTS = {
    "observation.mean": torch.tensor([1.0, 0.0]),
    "observation.std": torch.tensor([2.0, 0.5]),
    "log_std": torch.tensor([0.0]),
    "mlp.0.weight": torch.tensor([[3.0, -1.0]]),
    "mlp.0.bias": torch.tensor([0.25]),
}


def view(own: torch.Tensor, first: torch.Tensor | None = None) -> View:
    return View(own, own, torch.ones(len(own), dtype=torch.bool) if first is None else first)


def test_the_mean_by_hand(tmp_path: Path) -> None:
    save_policy(tmp_path / "s.safetensors", TINY, WEIGHTS, {"teacher": "t"})
    student = load_file(tmp_path / "s.safetensors", "s")
    # (2 − 1)/2 = 0.5, 9/0.5 = 18 clipped to 5: 3·0.5 − 5 + 0.25 = −3.25
    decision = student.act(view(torch.tensor([[2.0, 9.0]])), sample=False)
    assert decision.action.tolist() == [[-3.25]]
    assert decision.distribution is not None
    assert decision.distribution.std.tolist() == [1.0]
    assert student.info.provenance == {"teacher": "t"}


def test_arrays_of_other_libraries_are_stored_in_float32(tmp_path: Path) -> None:
    arrays = {name: tensor.double().numpy() for name, tensor in WEIGHTS.items()}
    save_policy(tmp_path / "a.safetensors", TINY, arrays, {})
    loaded = load_file(tmp_path / "a.safetensors", "a")
    assert loaded.info.sha256 == weights_sha256(WEIGHTS)
    with pytest.raises(
        VictimError, match=r"b\.safetensors: tensor 'log_std' is \(2,\) float32, expected \(1,\)"
    ):
        save_policy(tmp_path / "b.safetensors", TINY, {**arrays, "log_std": torch.zeros(2)}, {})
    assert not (tmp_path / "b.safetensors").exists()


@pytest.mark.parametrize(
    ("kind", "embed", "hidden"),
    [("mlp", 0, (5,)), ("mlp", 0, (7, 5)), ("mlp", 0, ()), ("lstm", 4, ()), ("lstm", 0, (6, 5))],
)
def test_the_file_acts_as_the_network_that_was_trained(
    tmp_path: Path, kind: Any, embed: int, hidden: tuple[int, ...]
) -> None:
    torch.manual_seed(3)
    shape = NetworkShape(kind, 6, 3, 0 if kind == "mlp" else 8, hidden, 2.0, embed)
    learner = StudentLearner(
        shape, minibatch=4, gradient_length=2, learning_rate=1e-3, device=torch.device("cpu")
    )
    mean, std, log_std = torch.randn(6), torch.rand(6) + 0.5, torch.randn(3)
    save_policy(tmp_path / "s.safetensors", shape, learner.weights(mean, std, log_std), {})
    student = load_file(tmp_path / "s.safetensors", "s")
    steps, games = 5, 4
    observation, done = 3 * torch.randn(steps, games, 6), torch.rand(steps, games) < 0.4
    z = ((observation - mean) / std).clamp(-2, 2)
    with torch.no_grad():
        at_once, _ = learner.network(z, done, learner.network.zero_state(games))
    first = torch.ones(games, dtype=torch.bool)
    for t in range(steps):
        acted = student.act(view(observation[t], first), sample=False, activations=True)
        torch.testing.assert_close(acted.action, at_once[t] * log_std.exp(), rtol=1e-4, atol=1e-5)
        assert acted.activations is not None
        assert acted.activations["hidden"].shape == (4, hidden[-1] if hidden else 8 if kind == "lstm" else 6)
        first = done[t]


def test_recurrent_state_is_saved_and_cleared() -> None:
    shape = NetworkShape("lstm", 2, 1, 4, (), 5.0)
    torch.manual_seed(0)
    weights = {name: torch.randn(size) for name, size in shape.tensors().items()}
    weights["observation.std"] = torch.ones(2)
    student = FrozenPolicy(PolicyInfo("s", "", 2, 1), shape, weights)
    own, go_on = torch.randn(3, 2), torch.zeros(3, dtype=torch.bool)
    opening = student.act(view(own), sample=False).action
    state = student.recurrent_state()
    second = student.act(view(own, go_on), sample=False).action
    assert not torch.equal(opening, second)
    student.load_recurrent_state(state)
    assert torch.equal(student.act(view(own, go_on), sample=False).action, second)
    mixed = student.act(view(own, torch.tensor([True, False, True])), sample=False).action
    assert torch.equal(mixed[[0, 2]], opening[[0, 2]])
    with pytest.raises(ValueError, match="s: 2 games after 3, and not all of them are new"):
        student.act(view(own[:2], go_on[:2]), sample=False)


def rewrite(path: Path, change: Callable[[dict[str, Any], dict[str, str]], None]) -> None:
    """A student's file with something changed, honestly sealed or not."""
    tensors = {name: tensor.clone() for name, tensor in WEIGHTS.items()}
    metadata = {
        "format": "apil-student-1",
        "shape": json.dumps({**TINY.__dict__, "hidden": []}),
        "weights_sha256": weights_sha256(tensors),
    }
    change(tensors, metadata)
    save_tensors(tensors, path, metadata)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, m: m.pop("format"), "has format 'none', expected 'apil-student-1'"),
        (lambda t, m: m.update(shape="{"), "its metadata are damaged"),
        (
            lambda t, m: m.update(shape=m["shape"].replace("mlp", "gru")),
            "its metadata are damaged (kind 'gru' is none of mlp, lstm)",
        ),
        (
            lambda t, m: m.update(shape=m["shape"].replace("5.0", "null")),
            "its metadata are damaged (clip None is no positive number)",
        ),
        (lambda t, m: t.pop("log_std"), "tensor 'log_std' is missing"),
        (
            lambda t, m: t.update(log_std=torch.zeros(2)),
            "tensor 'log_std' is (2,) float32, expected (1,) float32",
        ),
        (
            lambda t, m: t.update(log_std=torch.zeros(1, dtype=torch.float64)),
            "tensor 'log_std' is (1,) float64, expected (1,) float32",
        ),
        (lambda t, m: t["log_std"].fill_(torch.nan), "tensor 'log_std' holds numbers that are not finite"),
        (lambda t, m: t.update(more=torch.zeros(1)), "unknown tensors ['more']"),
        (lambda t, m: t["log_std"].fill_(0.5), "but the file says"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path: Path, change: Any, message: str) -> None:
    path = tmp_path / "s.safetensors"
    rewrite(path, change)
    with pytest.raises(VictimError) as caught:
        load_file(path, "victim")
    assert str(caught.value).startswith(f"victim: {path}")
    assert message in str(caught.value)


def test_no_file_and_no_safetensors(tmp_path: Path) -> None:
    with pytest.raises(VictimError, match="no file"):
        load_file(tmp_path / "none", "victim")
    (tmp_path / "text").write_text("hello")
    with pytest.raises(VictimError, match="is no safetensors file, or a damaged one"):
        load_file(tmp_path / "text", "victim")
