"""``sb3:FILE.zip``: an agent saved by Stable-Baselines3 (PPO, A2C, SAC, TD3, DDPG with ``MlpPolicy``).

Neither stable_baselines3 nor pickle is used: the plain JSON in the archive's ``data`` says what was
trained (the pickles beside it are passed over), and ``policy.pth`` is read with torch's
``weights_only=True``.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.policies.foreign.origin import Origin, one_line
from apil_core.policies.foreign.sb3_networks import make_policy

KIND = "a zip of Stable-Baselines3 (model.save)"

MAX_BYTES = 1 << 28
"""Largest part that is read."""


@dataclass(frozen=True)
class Facts:
    """What the plain JSON says of an agent.

    Attributes:
        observation_size, action_size: of its spaces.
        action_bounds: of its action space.
        activation: name of the class between layers, or ``None``: the algorithm's default.
    """

    observation_size: int
    action_size: int
    action_bounds: tuple[float, float]
    activation: str | None


def load(name: str) -> Policy:
    """The agent in that file.

    Raises:
        VictimError: there is no such file, it is damaged, or the agent is of a kind that is not supported.
    """
    origin = Origin.of("sb3", name)
    data, pth = _parts(origin)
    facts = _facts(origin, data)
    try:
        weights = torch.load(io.BytesIO(pth), map_location="cpu", weights_only=True)
    except Exception as error:
        raise origin.wrong("policy.pth with tensors only", one_line(error)) from error
    if not isinstance(weights, Mapping) or not all(
        isinstance(name, str) and isinstance(part, Tensor) for name, part in weights.items()
    ):
        raise origin.wrong("policy.pth with tensors only", f"a {type(weights).__name__} of other things")
    info = PolicyInfo(
        name=origin.name,
        sha256=origin.sha256,
        observation_size=facts.observation_size,
        action_size=facts.action_size,
        provenance={"trained steps": str(data.get("num_timesteps", "?"))},
        action_bounds=facts.action_bounds,
    )
    return make_policy(info, weights, facts.activation)


def _parts(origin: Origin) -> tuple[dict[str, Any], bytes]:
    try:
        with zipfile.ZipFile(origin.path) as archive:
            names = archive.namelist()
            missing = [part for part in ("data", "policy.pth") if part not in names]
            if missing:
                raise origin.wrong(KIND, f"a zip without {missing[0]!r}")
            if any(archive.getinfo(part).file_size > MAX_BYTES for part in ("data", "policy.pth")):
                raise origin.wrong(f"parts of at most {MAX_BYTES >> 20} MB", "a larger one")
            texts, pth = archive.read("data"), archive.read("policy.pth")
        data = json.loads(texts)
    except (zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, RuntimeError) as error:
        raise origin.wrong(KIND, one_line(error)) from error
    if not isinstance(data, dict):
        raise origin.wrong(KIND, "JSON of another kind in 'data'")
    return data, pth


def _facts(origin: Origin, data: Mapping[str, Any]) -> Facts:
    if data.get("use_sde"):
        raise origin.wrong("noise that does not depend on the state", "gSDE (use_sde=True), not supported")
    observation = _box(origin, data, "observation_space")
    action = _box(origin, data, "action_space")
    lows, highs = (_numbers(origin, action, key) for key in ("low", "high"))
    if len(set(lows)) != 1 or len(set(highs)) != 1:
        raise origin.wrong("the same bounds for all actions", f"{action['low']} to {action['high']}")
    kwargs = data.get("policy_kwargs") or {}
    if not isinstance(kwargs, dict):
        raise origin.wrong("a JSON object as policy_kwargs", f"a {type(kwargs).__name__}")
    for key in ("squash_output", "features_extractor_class"):
        if kwargs.get(key):
            raise origin.wrong("MlpPolicy as it comes", f"policy_kwargs[{key!r}], not supported")
    named = re.fullmatch(r"<class '(?:\w+\.)*(\w+)'>", str(kwargs.get("activation_fn")))
    if "activation_fn" in kwargs and named is None:
        found = repr(kwargs["activation_fn"])[:80]
        raise origin.wrong("the name of a class as policy_kwargs['activation_fn']", f"{found}, not supported")
    return Facts(
        observation["_shape"][0], action["_shape"][0], (lows[0], highs[0]), named.group(1) if named else None
    )


def _box(origin: Origin, data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """The readable part of a space, which must be a one-dimensional ``Box``."""
    space = data.get(key)
    kind = str(space.get(":type:", "nothing")) if isinstance(space, dict) else "nothing"
    shape = space.get("_shape") if isinstance(space, dict) else None
    if not kind.endswith(".Box'>") or not isinstance(shape, list) or len(shape) != 1:
        found = kind.removeprefix("<class '").removesuffix("'>").rpartition(".")[2]
        sizes = f" of shape {shape}" if shape else ""
        raise origin.wrong(f"a one-dimensional Box as {key}", f"{found}{sizes}, not supported")
    assert isinstance(space, dict)
    return space


def _numbers(origin: Origin, space: Mapping[str, Any], key: str) -> list[float]:
    """``"[-1. -1.]"`` as numbers."""
    try:
        values = [float(part) for part in str(space[key]).strip("[]").split()]
    except (KeyError, ValueError):
        values = []
    if len(values) != space["_shape"][0]:
        raise origin.wrong(f"readable bounds of the action space ({key})", f"{space.get(key)!r:.60}")
    return values
