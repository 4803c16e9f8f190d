"""The converter of docs/bring-an-adversary.md, run on files of Stable-Baselines 2's formats made by hand."""

from __future__ import annotations

import json
import pickle
import re
import runpy
import sys
import types
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from apil_core import View, load_policy

PAGE = Path(__file__).parents[2] / "docs" / "bring-an-adversary.md"
N, A, W = 7, 2, 3
"""Observations, actions and units of a layer."""

SHAPES = {
    **{"pi_fc0/w": (N, W), "pi_fc0/b": (W,), "vf_fc0/w": (N, W), "vf_fc0/b": (W,)},
    **{"pi_fc1/w": (W, W), "pi_fc1/b": (W,), "vf_fc1/w": (W, W), "vf_fc1/b": (W,)},
    **{
        "vf/w": (W, 1),
        "vf/b": (1,),
        "pi/w": (W, A),
        "pi/b": (A,),
        "pi/logstd": (1, A),
        "q/w": (W, A),
        "q/b": (A,),
    },
}
"""In the order of ``parameter_list`` in ppo2/CartPoleContinuousBulletEnv-v0.zip of rl-baselines-zoo."""

Arrays = dict[str, NDArray[np.float32]]


def arrays() -> Arrays:
    generator = np.random.default_rng(0)
    return {name: generator.normal(size=shape).astype("f4") for name, shape in SHAPES.items()}


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A module of the name of Stable-Baselines', with the classes that its pickles name."""
    name = "stable_baselines.common.running_mean_std"
    module = types.ModuleType(name)
    for kind in ("RunningMeanStd", "VecNormalize", "MlpPolicy"):
        setattr(module, kind, type(kind, (), {"__module__": name}))
    for part in ("stable_baselines", "stable_baselines.common", name):
        monkeypatch.setitem(sys.modules, part, module)
    return module


def statistics(library: Any) -> tuple[Any, NDArray[np.float64], NDArray[np.float64]]:
    moments = library.RunningMeanStd()
    moments.mean, moments.var, moments.count = np.arange(N) / 4, 1.0 + np.arange(N), 100.0
    return moments, moments.mean, moments.var


def files(library: Any, folder: Path, kind: str) -> tuple[Path, Path, float, float]:
    """Model, statistics, and the bound and ε of the normalisation."""
    found, (moments, *_) = arrays(), statistics(library)
    model, stats = folder / "model.pkl", folder / "stats.pkl"
    settings = {"gamma": 0.99, "policy": library.MlpPolicy}
    if kind == "zip":
        model = folder / "model.zip"
        with zipfile.ZipFile(model, "w") as archive:
            archive.writestr("data", json.dumps({"gamma": 0.99}))
            archive.writestr("parameter_list", json.dumps([f"model/{name}:0" for name in found]))
            with archive.open("parameters", "w") as file:
                np.savez(file, **{f"model/{name}:0": value for name, value in found.items()})
        norm = library.VecNormalize()
        norm.obs_rms, norm.clip_obs, norm.epsilon = moments, 1.0, 0.5
        stats.write_bytes(pickle.dumps(norm))
        return model, stats, 1.0, 0.5
    stored: Any = list(found.values())
    if kind == "with critics":  # of the fork of Guo et al. 2021
        stored = [stored, [np.ones((N, W), "f4")], [np.ones((N, W), "f4")]]
    if kind == "vector":
        model = folder / "model.npy"
        np.save(model, np.concatenate([value.ravel() for value in found.values()]))
    else:
        model.write_bytes(pickle.dumps((settings, stored)))
    stats.write_bytes(pickle.dumps(moments))
    return model, stats, 10.0, 1e-8


def scripts() -> tuple[str, str]:
    """The converter, and the function in it for agents in one vector."""
    first, second = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    old = re.search(r"def parameters.*?\n\n\n", first, re.DOTALL)
    assert old is not None
    return first, first.replace(old[0], second.replace("o=384, a=17, w=64", f"o={N}, a={A}, w={W}") + "\n\n")


@pytest.mark.parametrize("kind", ["pkl", "with critics", "zip", "vector"])
def test_the_converted_agent_acts_as_the_original(
    library: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    (tmp_path / "sb2.py").write_text(scripts()[kind == "vector"])
    model, stats, clip, epsilon = files(library, tmp_path, kind)
    _, mean, var = statistics(library)
    for name in [name for name in sys.modules if name.startswith("stable_baselines")]:
        monkeypatch.delitem(sys.modules, name)  # the reader has no such library
    monkeypatch.setattr(sys, "argv", ["sb2.py", str(model), str(stats), str(tmp_path / "out.safetensors")])
    runpy.run_path(str(tmp_path / "sb2.py"))
    policy = load_policy(f"safetensors:{tmp_path / 'out.safetensors'}")
    seen = 4 * np.random.default_rng(1).normal(size=(5, N)).astype("f4")
    own = torch.from_numpy(seen)
    found = policy.act(View(own, own, torch.ones(5, dtype=torch.bool)), sample=False)
    # FeedForwardPolicy behind VecNormalize: clip((x − mean) / √(var + ε)), two tanh layers, a linear mean
    agent = arrays()
    x = np.clip((seen - mean) / np.sqrt(var + epsilon), -clip, clip)
    for layer in ("pi_fc0", "pi_fc1"):
        x = np.tanh(x @ agent[f"{layer}/w"] + agent[f"{layer}/b"])
    expected = x @ agent["pi/w"] + agent["pi/b"]
    np.testing.assert_allclose(found.action.numpy(), expected, rtol=1e-4, atol=1e-5)
    assert found.distribution is not None
    np.testing.assert_allclose(found.distribution.std.numpy(), np.exp(agent["pi/logstd"][0]), rtol=1e-5)
