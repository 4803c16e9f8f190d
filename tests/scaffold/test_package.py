"""What ``apil new`` writes is complete, clean, found by apil, and does what it says."""

from __future__ import annotations

import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import apil_core
from apil_core import check_policy, load_policy, make_game, run
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.plugins.scaffold.names import LONGEST
from apil_core.plugins.scaffold.package import TEMPLATES, Written
from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.matrix import load_matrix
from apil_core.testing import check_game, tiny_config
from scaffold.packages import KINDS, write, write_all

COMMON = (
    *(".github/workflows/test.yml", ".gitignore", "LICENSE", "README.md", "config.yaml", "matrix.yaml"),
    *("pyproject.toml", "{package}/__init__.py", "{package}/py.typed", "tests/test_{identifier}.py"),
)
OWN = {
    "method": ("{package}/config.py", "{package}/method.py"),
    "game": ("{package}/game.py", "{package}/options.py", "{package}/victim.py"),
    "victim": ("{package}/policy.py", "{package}/weights/evader-v1.safetensors", "make_weights.py"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("new")


@pytest.fixture(scope="module")
def written(folder) -> dict[str, Written]:
    return write_all("sample", folder)


@pytest.fixture
def found(written, tmp_path, monkeypatch) -> PluginRegistry:
    """All plugins, with the three packages installed as far as Python can tell."""
    for made in written.values():
        entry = tomllib.loads((made.directory / "pyproject.toml").read_text())["project"]["entry-points"][
            "apil"
        ]
        info = tmp_path / f"{made.names.package}-0.1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {made.names.distribution}\nVersion: 0.1.0\n"
        )
        lines = "".join(f"{key} = {value}\n" for key, value in entry.items())
        (info / "entry_points.txt").write_text(f"[apil]\n{lines}")
        monkeypatch.syspath_prepend(str(made.directory))
    monkeypatch.syspath_prepend(str(tmp_path))
    yield discover()
    for name in [name for name in sys.modules if name.startswith("apil_sample")]:
        del sys.modules[name]


@pytest.mark.parametrize("kind", KINDS)
def test_all_files_are_there_and_nothing_else(written, kind):
    made = written[kind]
    names = {"package": made.names.package, "identifier": made.names.identifier}
    assert list(made.files) == sorted(path.format(**names) for path in (*COMMON, *OWN[kind]))
    assert sorted(path.name for path in made.directory.parent.iterdir()) == [
        f"sample-{k}" for k in sorted(KINDS)
    ]


def test_ruff_finds_nothing_whatever_the_name_is(written, folder, tmp_path):
    longest = "-".join(["abcdefghi"] * 3)[:LONGEST]
    for kind in KINDS:
        write(kind, longest, tmp_path / kind)
        write(kind, "q", tmp_path / kind)
    write("victim", "other", tmp_path, "sumo-ants", "fighter_1")
    for place in (folder, tmp_path):
        for check in (("check", "--no-cache"), ("format", "--check", "--no-cache")):
            command = [sys.executable, "-m", "ruff", *check, str(place)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("kind", KINDS)
def test_no_template_mark_is_left_and_links_lead_to_files(written, kind):
    directory = written[kind].directory
    for name in written[kind].files:
        if not name.endswith(".safetensors"):
            text = (directory / name).read_text("utf-8")
            assert not any(mark in text for mark in ("<<", ">>", "<%", "%>", "<#"))
    readme = (directory / "README.md").read_text("utf-8")
    assert "$$" in readme
    targets = [part.split(")")[0] for part in readme.split("](")[1:]]
    assert targets
    assert all((directory / target).exists() for target in targets)


@pytest.mark.parametrize("kind", KINDS)
def test_the_package_states_the_hooks_it_was_written_for(written, kind):
    names = written[kind].names
    text = (written[kind].directory / names.package / "__init__.py").read_text()
    assert f"\nAPIL_HOOK_API = {apil_core.HOOK_API}\n" in text
    workflow = YAML(typ="safe").load((written[kind].directory / ".github/workflows/test.yml").read_text())
    assert "${{ matrix.python }}" in str(workflow["jobs"]["test"]["steps"])


def test_apil_finds_what_they_offer(found):
    broken = {record.name: record.error for record in found.records if record.error}
    assert not {name for name in broken if name.startswith("sample")}, broken
    assert found.methods["sample_method"].config == "apil_sample_method.config:SampleMethodConfig"
    assert found.game("sample-game").default_victim == "sample-game:left/v1"
    assert {"sample-game", "sample-victim"} <= set(found.policies)


@pytest.mark.parametrize("kind", KINDS)
def test_its_own_tests_of_arithmetic_pass(found, written, kind):
    made = written[kind]
    tests = runpy.run_path(str(made.directory / "tests" / f"test_{made.names.identifier}.py"))
    by_hand = [name for name in tests if name.startswith("test_") and "every_check" not in name]
    assert len(by_hand) == 1
    tests[by_hand[0]]()


def test_the_method_trains_pays_its_bonus_and_keeps_its_state(found, tmp_path):
    import torch

    config = tiny_config("sample_method", steps=2 * 256, num_envs=16)
    run(config, out=tmp_path / "run", plugins=found)
    metrics = (tmp_path / "run" / "metrics.jsonl").read_text()
    assert '"reward/sample_method"' in metrics
    assert '"sample_method/habit"' in metrics
    (newest,) = sorted((tmp_path / "run" / "checkpoints").glob("*.pt"))[-1:]
    stored = torch.load(newest, weights_only=True)
    state = stored["methods"]["sample_method"]
    assert state["rollouts"] == 2
    assert state["habit"].abs().sum() > 0


def test_the_game_passes_every_check(found):
    assert "sample-game" in str(check_game("sample-game"))


def test_victims_fit_their_seats(found):
    for name, env in (("sample-victim:evader/v1", "toy-pursuit"), ("sample-game:left/v1", "sample-game")):
        seat, opponent = make_game(env, num_envs=1, plugins=found).layout.sides
        policy = load_policy(name, plugins=found)
        assert not check_policy(policy, seat, opponent).errors
        assert policy.info.name == name


@pytest.mark.parametrize("kind", KINDS)
def test_the_matrix_resolves_to_cells(found, written, kind):
    matrix = load_matrix(str(written[kind].directory / "matrix.yaml"))
    cells = resolve_matrix(matrix, found).cells
    assert len(cells) == {"method": 4, "game": 4, "victim": 8}[kind]


def test_every_template_has_the_suffix_that_keeps_tools_away():
    files = [file for file in TEMPLATES.rglob("*") if file.is_file()]
    assert files
    assert {file.suffix for file in files} == {".jinja"}
