"""Exported adversaries act as their runs do, in every format, and what cannot be exported is told."""

from __future__ import annotations

import json
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.small_runs import small_config
from safetensors import safe_open
from safetensors.torch import save_file

import apil_core
from apil_core import ApilError, ConfigError, RunDirError, VictimError, View, evaluate, load_policy, run
from apil_core.plugins.registry import default_plugins, make_game
from apil_core.training.export.export import Exported, export
from apil_core.training.export.run_policy import RunCheckpoint
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir

onnxruntime = pytest.importorskip("onnxruntime", reason="needs the extra onnx: pip install -e '.[onnx]'")

FORMATS = ("safetensors", "torchscript", "onnx")
RUNS: dict[str, tuple[str, dict[str, Any], tuple[str, ...]]] = {
    "adrl": ("adrl", {}, ("observation",)),
    "apl": ("apl", {}, ("observation",)),
    "apil": ("apil", {}, ("observation", "opponent")),
    "e_apil": ("e_apil", {}, ("observation", "opponent")),
    "oracle": ("apil", {"prediction": "oracle"}, ("observation", "opponent_action")),
    "noise": ("apil", {"prediction": "noise"}, ()),
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One short run each."""
    root = tmp_path_factory.mktemp("runs")
    for name, (method, options, _) in RUNS.items():
        run(small_config(method, options={"apil": options} if options else {}, steps=2048), out=root / name)
    return root


Exports = Callable[[str, Any], Exported]


@pytest.fixture(scope="module")
def exported(runs: Path) -> Exports:
    """Exports a run by name and format; each once, as torch takes seconds for ONNX."""

    @cache
    def make(name: str, format: Any) -> Exported:
        return export(runs / name, format, runs / f"{name}.{format}")

    return make


def real_views(games: int = 6, steps: int = 20) -> Iterator[View]:
    """What the pursuer sees in games with random actions."""
    game = make_game("toy-pursuit", num_envs=games)
    game.seed(7)
    game.reset()
    first = torch.ones(games, dtype=torch.bool)
    for _ in range(steps):
        theirs, own = (torch.from_numpy(part.copy()) for part in game.observations)
        actions = torch.rand(2, games, 2) * 2 - 1
        yield View(own, theirs, first, actions[0])
        step = game.step((actions[0].numpy(), actions[1].numpy()))
        first = torch.from_numpy(step.done.copy())
        game.reset(step.done.copy())


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("adrl", marks=pytest.mark.slow),  # by default in tests/cli/test_cli_foreign.py
        pytest.param("apl", marks=pytest.mark.slow),  # looks like ADRL's
        pytest.param("apil", marks=pytest.mark.slow),  # and this like E-APIL's
        "e_apil",
        "oracle",
    ],
)
@pytest.mark.parametrize("format", FORMATS)
def test_modes_and_spreads_are_the_runs(runs: Path, exported: Exports, name: str, format: Any) -> None:
    result = exported(name, format)
    assert result.difference <= 1e-5
    assert result.reads == (() if format == "safetensors" else RUNS[name][2])
    source = RunCheckpoint.find(runs / name)
    layout = make_game("toy-pursuit", num_envs=1).layout
    trained, _ = source.policy(source.run_dir.config(), layout, default_plugins(), 0, "run")
    written = load_policy(result.name, seat=layout.sides[1])
    for view in real_views():
        ours, theirs = (who.act(view, sample=False) for who in (trained, written))
        torch.testing.assert_close(theirs.action, ours.action, rtol=0, atol=1e-5)
        spreads = (who.distribution.std.expand(6, 2) for who in (theirs, ours))
        torch.testing.assert_close(*spreads, rtol=0, atol=1e-5)


def test_other_programs_find_inputs_and_outputs_by_name(exported: Exports) -> None:
    session = onnxruntime.InferenceSession(exported("e_apil", "onnx").file)
    assert [(part.name, part.shape[1]) for part in session.get_inputs()] == [
        ("observation", 7),
        ("opponent", 7),
    ]
    view = next(real_views())
    feed = {"observation": view.own.numpy(), "opponent": view.opponent.numpy()}
    mean, log_std = session.run(["mean", "log_std"], feed)
    assert (mean.shape, log_std.shape) == ((6, 2), (2,))
    script = torch.jit.load(exported("e_apil", "torchscript").file)
    torch.testing.assert_close(script(view.own, view.opponent)[0], torch.from_numpy(mean), rtol=0, atol=1e-5)


@pytest.mark.parametrize("format", FORMATS)
def test_scores_are_the_runs(runs: Path, exported: Exports, format: Any) -> None:
    """Both draw from the same generators in the same order, so the games are the same."""
    result = exported("e_apil", format)
    expected = evaluate(runs / "e_apil", episodes=60, seed=3)
    found = evaluate(result.name, env="toy-pursuit", episodes=60, seed=3)
    outcomes = ("wins", "ties", "losses", "causes", "mean_length")
    assert {key: getattr(found, key) for key in outcomes} == {key: getattr(expected, key) for key in outcomes}
    assert found.adversary.sha256 == result.sha256


def test_a_safetensors_file_holds_what_acting_needs_alone(exported: Exports) -> None:
    with safe_open(exported("e_apil", "safetensors").file, framework="pt") as file:
        names = set(file.keys())
    assert any("acting.policy" in name for name in names), "the imitator"
    assert not [name for name in names if "optimizer" in name or "critic" in name or "discriminator" in name]


def test_an_oracle_in_the_victims_seat_is_told(exported: Exports) -> None:
    result = exported("oracle", "onnx")
    with pytest.raises(VictimError, match="reads its opponent's action, so it must act second"):
        evaluate("random", victim=result.name, env="toy-pursuit", episodes=4)


@pytest.mark.parametrize("format", ["onnx", "torchscript"])
def test_what_draws_is_no_fixed_network(runs: Path, tmp_path: Path, format: Any) -> None:
    with pytest.raises(ApilError, match="use --format safetensors"):
        export(runs / "noise", format, tmp_path / "file")
    assert list(tmp_path.iterdir()) == []
    assert export(runs / "noise", "safetensors", tmp_path / "file").difference == 0


MEMORY = '''
import torch
from apil_core import Method, MethodSpec, hookimpl


class Memory(Method):
    """Remembers how often it was asked."""

    count = 0.0

    @hookimpl
    def extend_observation(self, context, view):
        self.count += 1.0
        return {"count": torch.ones_like(view.own[:, :1]) * self.count}


class Opening(Method):
    @hookimpl
    def extend_observation(self, context, view):
        return {"opening": view.first.float().unsqueeze(-1)}


@hookimpl
def register_methods():
    return [MethodSpec("memory", f"{__name__}:Memory"), MethodSpec("opening", f"{__name__}:Opening")]
'''


@pytest.fixture
def plugin(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "remembering.py"
    path.write_text(MEMORY)
    yield path
    sys.modules.pop("remembering", None)


def test_what_remembers_is_no_fixed_network(plugin: Path, tmp_path: Path) -> None:
    run(small_config("memory", steps=512, plugins=(str(plugin),)), out=tmp_path / "r")
    with pytest.raises(ApilError, match="does not act as the run does .* use --format safetensors"):
        export(tmp_path / "r", "torchscript", tmp_path / "file.pt")
    assert not (tmp_path / "file.pt").exists()


def test_the_start_of_a_game_can_be_an_input(plugin: Path, tmp_path: Path) -> None:
    run(small_config("opening", steps=512, plugins=(str(plugin),)), out=tmp_path / "r")
    assert export(tmp_path / "r", "torchscript", tmp_path / "file").reads == ("observation", "first")


def test_an_exported_file_needs_the_plugin_of_its_method(plugin: Path, tmp_path: Path) -> None:
    run(small_config("opening", steps=512, plugins=(str(plugin),)), out=tmp_path / "r")
    result = export(tmp_path / "r", "safetensors", tmp_path / "file")
    with pytest.raises(VictimError, match=r"needs the plugin that offers method 'opening' \(known: adrl, "):
        load_policy(result.name)
    found = evaluate(result.name, env="toy-pursuit", episodes=4, plugin_files=[str(plugin)])
    assert found.adversary.name == result.name


def test_where_it_came_from_is_in_the_file(exported: Exports) -> None:
    for format in FORMATS:
        result = exported("e_apil", format)
        told = load_policy(result.name, seat=make_game("toy-pursuit", num_envs=1).layout.sides[1]).info
        assert told.provenance == result.provenance
        assert told.provenance["method"] == "e_apil"
        assert told.provenance["steps"] == "2048"
        assert told.provenance["side"] == "pursuer"
        assert len(told.provenance["checkpoint_sha256"]) == 64
        assert told.action_bounds == (-1, 1)
    with safe_open(exported("e_apil", "safetensors").file, framework="pt") as file:
        metadata = file.metadata()
    assert metadata["format"] == "apil-adversary-1"
    assert json.loads(metadata["config"])["options"]["apil"]["prediction"] == "imitator"


def test_an_exported_adversary_fits_only_its_seat(exported: Exports) -> None:
    result = exported("adrl", "safetensors")
    with pytest.raises(ConfigError, match="is the pursuer of toy-pursuit; this is another seat"):
        evaluate("random", victim=result.name, env="toy-pursuit", episodes=4)


@pytest.mark.parametrize("cut", [100, 3000])
def test_a_damaged_file_is_told(runs: Path, tmp_path: Path, cut: int) -> None:
    result = export(runs / "adrl", "safetensors", tmp_path / "file")
    result.file.write_bytes(result.file.read_bytes()[:-cut])
    with pytest.raises(VictimError, match=f"^safetensors:{result.file}: expected a safetensors file, found "):
        load_policy(result.name)


def test_a_changed_weight_is_noticed(exported: Exports, tmp_path: Path) -> None:
    content = bytearray(exported("adrl", "safetensors").file.read_bytes())
    content[-3] ^= 0x40
    (bad := tmp_path / "bad").write_bytes(content)
    with pytest.raises(
        VictimError, match=r"a damaged one \(ValueError: its tensors have SHA-256 \w{64}, not \w{64}\)$"
    ):
        load_policy(f"safetensors:{bad}")


def test_a_file_without_a_hash_loads(exported: Exports, tmp_path: Path) -> None:
    with safe_open(exported("adrl", "safetensors").file, framework="pt") as file:
        metadata, tensors = file.metadata(), {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    del metadata["tensors_sha256"]
    save_file(tensors, old := tmp_path / "old", metadata)
    assert load_policy(f"safetensors:{old}").info.provenance["method"] == "adrl"


def test_no_run_no_directory(runs: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere is no run directory"):
        export("nowhere", "onnx")
    with pytest.raises(RunDirError, match="is no run directory"):
        export(tmp_path, "onnx")
    with pytest.raises(ConfigError, match=r"--out .*: no directory "):
        export(runs / "adrl", "safetensors", tmp_path / "no" / "file")
    with pytest.raises(ConfigError, match="is a directory"):
        export(runs / "adrl", "safetensors", tmp_path)


def test_the_default_place_is_in_the_run(runs: Path) -> None:
    result = export(runs / "adrl", "safetensors")
    assert result.file == RunDir(runs / "adrl").path / "adversary.safetensors"
    older = RunDir(runs / "adrl").checkpoints()[0]
    again = export(runs / "adrl", "safetensors", checkpoint_path=older, force=True)
    assert again.provenance["steps"] == "1024"


def test_a_file_that_exists_is_only_replaced_if_asked(runs: Path) -> None:
    config = runs / "adrl" / "config.yaml"
    before = config.read_bytes()
    with pytest.raises(ConfigError, match=r"config\.yaml exists already; choose another --out, or --force"):
        export(runs / "adrl", "safetensors", config)
    assert config.read_bytes() == before


def test_actions_that_are_no_numbers_are_not_exported(runs: Path, tmp_path: Path) -> None:
    newest = RunDir(runs / "adrl").newest_checkpoint()
    state = checkpoint.read(newest)
    next(iter(state["learner"]["ppo"]["actor_state_dict"].values())).fill_(torch.nan)
    checkpoint.save(tmp_path / newest.name, state)
    for format in ("safetensors", "torchscript"):
        with pytest.raises(ApilError, match="are not finite: its training diverged"):
            export(runs / "adrl", format, tmp_path / "file", checkpoint_path=tmp_path / newest.name)
        assert not (tmp_path / "file").exists()


def test_folders_of_this_machine_stay_here(runs: Path, plugin: Path, tmp_path: Path) -> None:
    changes: dict[str, Any] = {"steps": 512, "victim_side": 1}
    run(small_config("adrl", **changes, victim=f"run:{runs / 'adrl'}"), out=tmp_path / "second")
    export(runs / "adrl", "safetensors", tmp_path / "v")
    changes |= {"plugins": (str(plugin),), "init_from": tmp_path / "second"}
    run(small_config("adrl", **changes, victim=f"safetensors:{tmp_path}/v"), out=tmp_path / "r")
    for name, victim in (("second", r"run:adrl/checkpoints/iteration-\d+\.pt"), ("r", "safetensors:v")):
        result = export(tmp_path / name, "safetensors", tmp_path / f"{name}.safetensors")
        assert re.fullmatch(victim, result.provenance["victim"])
        assert not any(str(root).encode() in result.file.read_bytes() for root in (tmp_path, runs))
        assert load_policy(result.name).info.provenance == result.provenance


@pytest.mark.parametrize("format", ["torchscript", "onnx"])
def test_networks_name_no_files_of_this_machine(exported: Exports, format: str) -> None:
    file = exported("e_apil", format).file
    content = [file.read_bytes()]
    if format == "torchscript":
        with zipfile.ZipFile(file) as archive:
            content = [archive.read(name) for name in archive.namelist()]
    for place in (Path(torch.__file__).parent, Path(apil_core.__file__).parent, file.parent):
        assert not any(str(place).encode() in part for part in content)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("state", "[]"),
        ("state", '{"mapping": [["groups", {"list": []}]]}'),
        ("state", "[" * 100_000),
        ("config", "[]"),
        ("layout", "[]"),
        ("side", "7"),
        ("side", "-1"),
        ("provenance", "[1]"),
    ],
)
def test_metadata_that_are_wrong_are_told(exported: Exports, tmp_path: Path, key: str, value: str) -> None:
    with safe_open(exported("adrl", "safetensors").file, framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  (no mapping)
        metadata = file.metadata()
    save_file(tensors, tmp_path / "bad", {**metadata, key: value})
    with pytest.raises(VictimError, match=rf"^safetensors:{tmp_path}/bad: expected .*, found ") as caught:
        load_policy(f"safetensors:{tmp_path}/bad")
    assert "\n" not in str(caught.value)
