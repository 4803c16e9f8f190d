"""TorchScript, torch.export and ONNX: one convention, the same actions, and mistakes that are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import onnx
import pytest
import torch
from helpers.small_runs import differences, final_state, small_config
from torch import nn

from apil_core import VictimError, load_policy, resume, run
from apil_core.policies.conformance import check_policy
from apil_core.policies.foreign.network import NetworkPolicy, Signature
from apil_core.policies.foreign.origin import Origin
from policies.foreign_files import Gaussian, Plain, Recurrent, save, seat, view

SUFFIXES = (".pt", ".pt2", ".onnx")

pytest.importorskip("onnxruntime", reason="needs the extra onnx: pip install -e '.[onnx]'")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_network_acts_as_it_does_in_torch(tmp_path: Path, suffix: str) -> None:
    policy = load_policy(save(Plain(), tmp_path / f"net{suffix}"), seat=seat())
    assert (policy.info.observation_size, policy.info.action_size) == (7, 2)
    assert len(policy.info.sha256) == 64
    for games in (1, 5, 9):
        decision = policy.act(view(games), sample=True)
        torch.testing.assert_close(decision.action, Plain()(view(games).own), rtol=1e-5, atol=1e-6)
        assert decision.distribution is None
    assert not check_policy(policy, seat()).stochastic


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_mean_and_log_std_make_a_distribution(tmp_path: Path, suffix: str) -> None:
    policy = load_policy(save(Gaussian(), tmp_path / f"net{suffix}"), seat=seat())
    decision = policy.act(view(), sample=True, generator=torch.Generator().manual_seed(3))
    mean, log_std = Gaussian()(view().own)
    noise = torch.randn(5, 2, generator=torch.Generator().manual_seed(3))
    torch.testing.assert_close(decision.action, mean + log_std.exp() * noise, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(decision.distribution.std, log_std.exp())
    torch.testing.assert_close(policy.act(view(), sample=False).action, mean, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_states_are_carried_along_and_cleared_where_a_game_starts(tmp_path: Path, suffix: str) -> None:
    policy = load_policy(save(Recurrent(), tmp_path / f"net{suffix}", {"state": [5, 5]}), seat=seat())
    assert check_policy(policy, seat()).recurrent
    h = c = torch.zeros(5, 5)
    for step, first in enumerate(([True] * 5, [False] * 5, [False, True, False, True, False])):
        now = view(seed=step)
        now.first = torch.tensor(first)
        h, c = (torch.where(now.first.unsqueeze(1), torch.zeros(5, 5), part) for part in (h, c))
        action, h, c = Recurrent()(now.own, h, c)
        found = policy.act(now, sample=False).action
        torch.testing.assert_close(found, action, rtol=1e-5, atol=1e-6)
    assert policy.recurrent_state()["state_0"].shape == (5, 5)
    saved = {name: part.clone() for name, part in policy.recurrent_state().items()}
    following = policy.act(view(first=False, seed=9), sample=False).action
    policy.load_recurrent_state(saved)
    assert torch.equal(policy.act(view(first=False, seed=9), sample=False).action, following)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_network_that_reads_its_opponent(tmp_path: Path, suffix: str) -> None:
    told = {"reads": ["opponent"], "action_size": 2, "action_bounds": [-1, 1], "provenance": {"who": "me"}}
    policy = load_policy(save(Plain(), tmp_path / f"net{suffix}", told), seat=seat())
    found = policy.act(view(), sample=False).action
    torch.testing.assert_close(found, Plain()(view().opponent), rtol=1e-5, atol=1e-6)
    assert policy.info.action_bounds == (-1, 1)
    assert policy.info.provenance == {"who": "me"}
    told.pop("action_size")
    with pytest.raises(VictimError, match=r"reads opponent, so its apil\.json must state action_size"):
        load_policy(save(Plain(), tmp_path / f"net2{suffix}", told), seat=seat())


@pytest.mark.parametrize(
    ("suffix", "expected"),
    [
        (".pt", r"net\.pt fails on inputs \(2, 7\), \(2, 5\): RuntimeError: forward\(\) "),
        (".pt2", r"net\.pt2 fails on inputs \(2, 7\), \(2, 5\): ValueError"),
        (".onnx", r"expected 2 inputs .* found observation \['\w+', 7\], h \['\w+', 5\], c "),
    ],
)
def test_states_that_nobody_told_of(tmp_path: Path, suffix: str, expected: str) -> None:
    name = save(Recurrent(), tmp_path / f"net{suffix}", {"state": [5]}, widths=(7, 5, 5))
    with pytest.raises(VictimError, match=expected):
        load_policy(name, seat=seat())


def test_observations_of_another_size_are_told(tmp_path: Path) -> None:
    with pytest.raises(
        VictimError, match=r"fails on inputs \(2, 9\): RuntimeError: mat1 and mat2 .*\(2x9 and 7x8\)"
    ):
        load_policy(save(Plain(), tmp_path / "net.pt", {"observation_size": 9}), seat=seat())
    with pytest.raises(VictimError, match="states 9 observations and takes 7"):
        load_policy(save(Plain(), tmp_path / "net.onnx", {"observation_size": 9}, widths=(7,)), seat=seat())


def test_a_file_that_does_not_state_its_sizes_needs_a_seat(tmp_path: Path) -> None:
    name = save(Plain(), tmp_path / "net.pt")
    with pytest.raises(VictimError, match="does not state its sizes: say which seat it is for"):
        load_policy(name)
    assert load_policy(save(Plain(), tmp_path / "net.onnx")).info.observation_size == 7
    told = save(Plain(), tmp_path / "told.pt", {"observation_size": 7})
    assert load_policy(told).info.action_size == 2


class Three(nn.Module):
    def forward(self, observation: torch.Tensor) -> list[torch.Tensor]:
        return [observation[:, :2]] * 3


class Table(nn.Module):
    def forward(self, observation: torch.Tensor) -> dict[str, torch.Tensor]:
        return {"action": observation[:, :2]}


@pytest.mark.parametrize(("network", "got"), [(Three(), "3"), (Table(), "dict")])
def test_other_outputs_are_told(tmp_path: Path, network: nn.Module, got: str) -> None:
    name = save(network, tmp_path / "net.pt")
    with pytest.raises(VictimError, match=rf"expected an action, or mean and log_std, .* got {got}$"):
        load_policy(name, seat=seat())


class Critic(nn.Module):
    """One action, and a value as its second output."""

    def __init__(self) -> None:
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(1)
            self.net = nn.Linear(7, 2)

    def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        both = self.net(observation)
        return both[:, :1], both[:, 1:]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_value_is_not_taken_for_the_spread_of_one_action(tmp_path: Path, suffix: str) -> None:
    one = replace(seat(), action_size=1)
    policy = load_policy(save(Critic(), tmp_path / f"net{suffix}"), seat=one)
    with pytest.raises(VictimError, match="second output depends on the observation: give the action alone"):
        check_policy(policy, one)
    named = load_policy(save(Critic(), tmp_path / f"named{suffix}", {"gives": ["mean", "log_std"]}), seat=one)
    assert check_policy(named, one).stochastic
    mean, log_std = Critic()(view().own)
    distribution = named.act(view(), sample=False).distribution
    torch.testing.assert_close(distribution.std, log_std.exp(), rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(distribution.mean, mean, rtol=1e-5, atol=1e-6)


def test_an_output_called_value_is_refused(tmp_path: Path) -> None:
    model = onnx.load_from_string(Path(save(Gaussian(), tmp_path / "a.onnx").partition(":")[2]).read_bytes())
    first = model.graph.output[1].name
    for node in model.graph.node:
        node.output[:] = ["value" if name == first else name for name in node.output]
    for part in model.graph.initializer:
        part.name = "value" if part.name == first else part.name
    model.graph.output[1].name = "value"
    onnx.save(model, tmp_path / "b.onnx")
    with pytest.raises(VictimError, match="expected an action, or mean and log_std, found an output 'value'"):
        load_policy(f"onnx:{tmp_path}/b.onnx", seat=seat())

    class Both(NamedTuple):
        action: torch.Tensor
        state_value: torch.Tensor

    origin = Origin("python:x", "", tmp_path)
    with pytest.raises(VictimError, match="python:x: .* found an output 'state_value'"):
        NetworkPolicy(origin, lambda inputs: Both(*Critic()(*inputs)), Signature(), seat())


def test_doubles_are_told(tmp_path: Path) -> None:
    policy = load_policy(save(DoublePlain(), tmp_path / "net.pt"), seat=seat())
    with pytest.raises(VictimError, match="action must be float32, got float64"):
        check_policy(policy, seat())


class DoublePlain(Plain):
    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.net(observation).double()


@pytest.mark.parametrize("scheme", ["torchscript", "torch-export", "onnx", "sb3", "safetensors"])
def test_files_that_are_none(tmp_path: Path, scheme: str) -> None:
    with pytest.raises(
        VictimError, match=rf"^{scheme}:nowhere: .*nowhere: no such file; expected {scheme}:FILE$"
    ):
        load_policy(f"{scheme}:nowhere", seat=seat())
    (tmp_path / "text").write_text("hello")
    with pytest.raises(VictimError, match=rf"^{scheme}:{tmp_path}/text: expected .*, found ") as caught:
        load_policy(f"{scheme}:{tmp_path}/text", seat=seat())
    assert "\n" not in str(caught.value)


def test_another_kind_of_archive_is_told(tmp_path: Path) -> None:
    save(Plain(), tmp_path / "a.pt")
    save(Plain(), tmp_path / "a.pt2")
    with pytest.raises(VictimError, match="found an archive without TorchScript code"):
        load_policy(f"torchscript:{tmp_path}/a.pt2", seat=seat())
    with pytest.raises(VictimError, match="with one model, found an archive without it"):
        load_policy(f"torch-export:{tmp_path}/a.pt", seat=seat())


class Sum(nn.Module):
    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return observation.sum()


def test_an_action_for_all_games_together_is_told(tmp_path: Path) -> None:
    with pytest.raises(VictimError, match=r"expected actions \(2, a\) for two games, got \(\)"):
        load_policy(save(Sum(), tmp_path / "net.pt"), seat=seat())


def test_a_signature_that_is_wrong_is_told(tmp_path: Path) -> None:
    with pytest.raises(VictimError, match=r"its apil\.json is wrong: states: Extra inputs"):
        load_policy(save(Plain(), tmp_path / "net.pt", {"states": [5]}), seat=seat())
    name = save(Plain(), tmp_path / "net.pt", {"reads": ["weather"]})
    with pytest.raises(
        VictimError, match=r"its apil\.json is wrong: reads\.0: Input should be 'observation'"
    ):
        load_policy(name, seat=seat())


def test_a_run_against_a_recurrent_network_is_resumed_bit_for_bit(tmp_path: Path) -> None:
    victim = save(Recurrent(), tmp_path / "net.onnx", {"state": [5, 5]})
    run(small_config("adrl", victim=victim), out=tmp_path / "whole")
    run(small_config("adrl", victim=victim, steps=1024), out=tmp_path / "parts")
    resume(tmp_path / "parts", steps=small_config().steps)
    whole, parts = (final_state(tmp_path / name) for name in ("whole", "parts"))
    assert whole["env"]["victim"]["state_0"].abs().sum() > 0
    assert differences(whole, parts) == []


def test_weights_in_a_second_file_belong_to_the_hash(tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    save(Plain(), path)
    plain = load_policy(f"onnx:{path}").info.sha256
    model = onnx.load(path)
    onnx.save(model, path, save_as_external_data=True, location="net.onnx.data", size_threshold=0)
    policy = load_policy(f"onnx:{path}")
    torch.testing.assert_close(
        policy.act(view(), sample=False).action, Plain()(view().own), rtol=1e-5, atol=1e-6
    )
    weights = tmp_path / "net.onnx.data"
    weights.write_bytes(weights.read_bytes()[::-1])
    hashes = {plain, policy.info.sha256, load_policy(f"onnx:{path}").info.sha256}
    assert len(hashes) == 3


def test_files_of_weights_belong_to_the_hash_whatever_their_names(tmp_path: Path) -> None:
    path, weights = tmp_path / "net.onnx", tmp_path / "numbers.bin"
    save(Plain(), path)
    onnx.save(onnx.load(path), path, save_as_external_data=True, location=weights.name, size_threshold=0)
    before = load_policy(f"onnx:{path}").info.sha256
    weights.write_bytes(weights.read_bytes()[::-1])
    assert load_policy(f"onnx:{path}").info.sha256 != before


@pytest.mark.parametrize("how", ["../weights", "absolute", "link", "missing"])
def test_weights_outside_the_folder_of_their_model_are_refused(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    save(Plain(), folder / "net.onnx")
    model = onnx.load(folder / "net.onnx")
    onnx.save(model, folder / "net.onnx", save_as_external_data=True, location="weights", size_threshold=0)
    (folder / "weights").rename(tmp_path / "weights")
    if how == "link":
        (folder / how).symlink_to(tmp_path / "weights")
    location = str(tmp_path / "weights") if how == "absolute" else how
    model = onnx.load(folder / "net.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        for entry in tensor.external_data:
            if entry.key == "location":
                entry.value = location
    (folder / "net.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(VictimError, match=rf"expected its weights in a file in .*, found '{location}'"):
        load_policy(f"onnx:{folder}/net.onnx")


def test_restored_states_are_where_the_policy_is() -> None:
    signature = Signature(state=(5, 5))
    origin = Origin("made up", "", Path())
    policy = NetworkPolicy(origin, lambda inputs: Recurrent()(*inputs), signature, seat())
    policy.act(view(), sample=False)
    rows = policy.recurrent_state()
    policy.to("meta")
    policy.load_recurrent_state(rows)
    assert {part.device.type for part in policy.recurrent_state().values()} == {"meta"}
