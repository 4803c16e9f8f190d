"""What a plugin's loader gets, when it is asked at all, and what is said where a library is missing."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from apil_core import ApilError, VictimError, load_policy
from apil_core.common.extras import install_command
from apil_core.plugins.discovery import PluginRegistry, discover
from policies.foreign_files import seat

PLUGIN = """
from apil_core import Decision, Policy, PolicyInfo, PolicySpec, hookimpl

asked = []


class Still(Policy):
    def __init__(self, name, sizes):
        self.info = PolicyInfo(name, "0" * 64, *sizes)

    def act(self, view, *, sample, generator=None, activations=False):
        return Decision(view.own.new_zeros(len(view.own), self.info.action_size))


def plain(name):
    asked.append(name)
    return Still(f"plain:{name}", (7, 2))


def seated(name, seat):
    asked.append((name, seat and seat.name))
    return Still(f"seated:{name}", (seat.observation_size, seat.action_size) if seat else (1, 1))


def whole(name, plugins, device):
    asked.append((name, sorted(plugins.methods)[:1], device))
    return Still(f"whole:{name}", (7, 2))


@hookimpl
def register_policies():
    return [
        PolicySpec("plain", f"{__name__}:plain"),
        PolicySpec("seated", f"{__name__}:seated", seat=True),
        PolicySpec("whole", f"{__name__}:whole", plugins=True),
        PolicySpec("code", f"{__name__}:plain", runs_code=True),
    ]
"""


@pytest.fixture
def plugins(tmp_path: Path) -> Iterator[PluginRegistry]:
    file = tmp_path / "loaders.py"
    file.write_text(PLUGIN)
    yield discover([file])
    sys.modules.pop("loaders", None)


def test_a_loader_gets_what_its_flags_ask_for(plugins: PluginRegistry) -> None:
    for name in ("plain:a", "seated:b", "whole:c"):
        load_policy(name, plugins=plugins, seat=seat())
    assert load_policy("seated:d", plugins=plugins).info.observation_size == 1
    assert sys.modules["loaders"].asked == ["a", ("b", "evader"), ("c", ["adrl"], "cpu"), ("d", None)]


def test_a_loader_that_runs_code_is_not_asked_unless_trusted(plugins: PluginRegistry) -> None:
    with pytest.raises(VictimError, match=r"code:x runs code when it is loaded"):
        load_policy("code:x", plugins=plugins)
    assert sys.modules["loaders"].asked == []
    load_policy("code:x", plugins=plugins, trust=True)
    assert sys.modules["loaders"].asked == ["x"]


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)  # what Python itself puts there to say: absent
    with pytest.raises(
        ApilError, match=re.escape(f"ONNX policies need onnxruntime: {install_command('onnx')}")
    ):
        load_policy(f"onnx:{tmp_path}/net.onnx")


def test_finding_the_formats_imports_nothing_heavy() -> None:
    code = (
        "import sys, apil_core.policies.foreign.plugin as p; p.register_policies();"
        "assert not {'torch', 'mujoco', 'onnxruntime', 'stable_baselines3', 'numpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
