"""``sb3:FILE.zip``: an agent saved by Stable-Baselines3 or sb3-contrib, with ``MlpPolicy``.

Neither stable_baselines3 nor pickle is used: the plain JSON in the archive's ``data`` describes the agent
(the pickles in it are ignored), and ``policy.pth`` is read with torch's ``weights_only=True``.
"""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.common.errors import reason_of
from apil_core.policies.foreign.origin import Origin
from apil_core.policies.foreign.sb3_networks import ARS, KNOWN, make_policy

KIND = "a zip of Stable-Baselines3 (model.save)"

MAX_BYTES = 1 << 28
"""Largest part that is read."""


@dataclass(frozen=True)
class Facts:
    """Description of an agent in the plain JSON.

    Attributes:
        observation_size, action_size: of its spaces; a ``Discrete`` action has a score per choice.
        action_bounds: of its action space; infinite for scores.
        module: of the policy's class.
        squashes: True if ARS's actions end in a tanh.
        activation: name of the class between layers, or ``None``: the algorithm's default.
    """

    observation_size: int
    action_size: int
    action_bounds: tuple[float, float]
    module: str
    squashes: bool
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
        raise origin.wrong("policy.pth with tensors only", reason_of(error)) from error
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
    return make_policy(info, weights, facts.module, facts.activation, squashes=facts.squashes)


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
        raise origin.wrong(KIND, reason_of(error)) from error
    if not isinstance(data, dict):
        raise origin.wrong(KIND, "JSON of another kind in 'data'")
    return data, pth


def _facts(origin: Origin, data: Mapping[str, Any]) -> Facts:
    if data.get("use_sde"):
        raise origin.wrong("noise that does not depend on the state", "gSDE (use_sde=True), not supported")
    made = data.get("policy_class")
    made = made if isinstance(made, dict) else {}
    if (module := str(made.get("__module__"))) not in KNOWN:
        raise origin.wrong(f"a policy class of {', '.join(KNOWN)}", f"one of {module[:80]}, not supported")
    observation, _ = _box(origin, data, "observation_space")
    action, bounds = _actions(origin, data)
    kwargs = data.get("policy_kwargs") or {}
    if not isinstance(kwargs, dict):
        raise origin.wrong("a JSON object as policy_kwargs", f"a {type(kwargs).__name__}")
    linear = "ARSLinearPolicy" in str(made.get("__init__"))
    squashes = bool(kwargs.get("squash_output", module == ARS and not linear))
    for key in ("squash_output", "features_extractor_class"):
        if kwargs.get(key) and (key, module) != ("squash_output", ARS):
            raise origin.wrong("MlpPolicy as it comes", f"policy_kwargs[{key!r}], not supported")
    named = re.fullmatch(r"<class '(?:\w+\.)*(\w+)'>", str(kwargs.get("activation_fn")))
    if "activation_fn" in kwargs and named is None:
        found = repr(kwargs["activation_fn"])[:80]
        raise origin.wrong("the name of a class as policy_kwargs['activation_fn']", f"{found}, not supported")
    return Facts(observation, action, bounds, module, squashes, named.group(1) if named else None)


def _actions(origin: Origin, data: Mapping[str, Any]) -> tuple[int, tuple[float, float]]:
    """Size and bounds of an action."""
    space = data.get("action_space")
    if isinstance(space, dict) and str(space.get(":type:")).endswith(".Discrete'>"):
        if not re.fullmatch(r"[1-9]\d{0,4}", count := str(space.get("n"))):
            raise origin.wrong("a number of choices as action_space", f"{count:.60}")
        return int(count), (-math.inf, math.inf)
    size, box = _box(origin, data, "action_space")
    lows, highs = (_numbers(origin, box, key, size) for key in ("low", "high"))
    if len(set(lows)) != 1 or len(set(highs)) != 1:
        raise origin.wrong("the same bounds for all actions", f"{box['low']} to {box['high']}")
    return size, (lows[0], highs[0])


def _box(origin: Origin, data: Mapping[str, Any], key: str) -> tuple[int, Mapping[str, Any]]:
    """Size and readable part of a space, which must be a one-dimensional ``Box``."""
    space = data.get(key)
    kind = str(space.get(":type:", "nothing")) if isinstance(space, dict) else "nothing"
    # without the underscore: gym before 0.21, so Stable-Baselines3 up to 1.3
    shape = space.get("_shape", space.get("shape")) if isinstance(space, dict) else None
    fits = isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int)
    if not kind.endswith(".Box'>") or not fits:
        found = kind.removeprefix("<class '").removesuffix("'>").rpartition(".")[2]
        sizes = f" of shape {shape}" if shape else ""
        raise origin.wrong(f"a one-dimensional Box as {key}", f"{found}{sizes}, not supported")
    assert isinstance(space, dict)
    assert isinstance(shape, list)
    return shape[0], space


def _numbers(origin: Origin, space: Mapping[str, Any], key: str, size: int) -> list[float]:
    """``"[-1. -1.]"`` as numbers."""
    try:
        values = [float(part) for part in str(space[key]).strip("[]").split()]
    except (KeyError, ValueError):
        values = []
    if len(values) != size:
        raise origin.wrong(f"readable bounds of the action space ({key})", f"{space.get(key)!r:.60}")
    return values
