"""Networks as other people would save them, for toy-pursuit's seats (7 observations, 2 actions)."""

from __future__ import annotations

import io
import json
import os
import pickle
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import Tensor, nn

from apil_core import SideLayout, View
from apil_core.plugins.registry import make_game

OBSERVATIONS, ACTIONS = 7, 2


def seat(side: int = 0) -> SideLayout:
    """A seat of toy-pursuit: the evader's, which is attacked by default, or the pursuer's."""
    return make_game("toy-pursuit", num_envs=1).layout.sides[side]


def view(games: int = 5, *, first: bool = True, seed: int = 0) -> View:
    """Made-up observations."""
    generator = torch.Generator().manual_seed(seed)
    own, opponent = (torch.randn(games, OBSERVATIONS, generator=generator) for _ in range(2))
    return View(own, opponent, torch.full((games,), first))


class Plain(nn.Module):
    """A deterministic MLP."""

    def __init__(self, observations: int = OBSERVATIONS, actions: int = ACTIONS) -> None:
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(1)
            self.net = nn.Sequential(nn.Linear(observations, 8), nn.Tanh(), nn.Linear(8, actions))

    def forward(self, observation: Tensor) -> Tensor:
        return self.net(observation)


class Gaussian(Plain):
    """Mean and state-independent log standard deviation."""

    def __init__(self) -> None:
        super().__init__()
        self.log_std = nn.Parameter(torch.tensor([-1.0, 0.5]))

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        return self.net(observation), self.log_std


class Recurrent(nn.Module):
    """An LSTM that carries h and c as further inputs and outputs."""

    def __init__(self) -> None:
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(2)
            self.cell = nn.LSTMCell(OBSERVATIONS, 5)
            self.out = nn.Linear(5, ACTIONS)

    def forward(self, observation: Tensor, h: Tensor, c: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        h, c = self.cell(observation, (h, c))
        return self.out(h), h, c


def save(
    network: nn.Module,
    path: Path,
    told: dict[str, Any] | None = None,
    *,
    games: int | None = None,
    widths: tuple[int, ...] | None = None,
) -> str:
    """Save a network by the suffix of ``path``; returns its name for ``apil``.

    Args:
        network: to save.
        path: ``.pt``, ``.pt2`` or ``.onnx``.
        told: content of ``apil.json``.
        games: a fixed number of games instead of any.
        widths: of its inputs; default: 7, and the states that are told of.
    """
    wanted = widths or (OBSERVATIONS, *(told or {}).get("state", []))
    path.write_bytes(_content(type(network), path.suffix, json.dumps(told or {}), games, wanted))
    scheme = {".pt": "torchscript", ".pt2": "torch-export", ".onnx": "onnx"}[path.suffix]
    return f"{scheme}:{path}"


def _content(
    kind: type[nn.Module], suffix: str, told: str, games: int | None, widths: tuple[int, ...]
) -> bytes:
    extra = {"apil.json": told}
    inputs = tuple(torch.zeros(games or 2, width) for width in widths)
    buffer = io.BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        if suffix == ".pt":
            torch.jit.save(torch.jit.script(kind().eval()), buffer, _extra_files=extra)
            return buffer.getvalue()
        if suffix == ".onnx":
            model = onnx.load_from_string(_onnx(kind, games, inputs_of=widths))
            onnx.helper.set_model_props(model, extra)
            return model.SerializeToString()
        torch.export.save(_program(kind(), inputs, games), buffer, extra_files=extra)
        return buffer.getvalue()


def _program(network: nn.Module, inputs: tuple[Tensor, ...], games: int | None) -> Any:
    axes = None if games else tuple({0: torch.export.Dim("games")} for _ in inputs)
    return torch.export.export(network.eval(), inputs, dynamic_shapes=axes)


@cache  # torch takes seconds for it
def _onnx(kind: type[nn.Module], games: int | None, inputs_of: tuple[int, ...]) -> bytes:
    inputs = tuple(torch.zeros(games or 2, width) for width in inputs_of)
    made = torch.onnx.export(_program(kind(), inputs, games), dynamo=True, verbose=False)
    assert made is not None
    return made.model_proto.SerializeToString()


class Attack:
    """Unpickling this creates a file."""

    def __init__(self, mark: Path):
        self.mark = mark

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return os.system, (f"touch {self.mark}",)


def malicious(mark: Path) -> bytes:
    """A pickle that creates ``mark`` for whoever unpickles it."""
    return pickle.dumps(Attack(mark), protocol=2)
