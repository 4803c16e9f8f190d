"""A trained adversary in one safetensors file: weights, statistics, methods' state and requirements.

It contains no code. Loading builds the adversary from installed plugins, so those of its method and of its
observers must be among them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from apil_core.api.config import RunConfig
from apil_core.api.game import GameLayout, SideLayout
from apil_core.api.policy import PolicyInfo
from apil_core.common.errors import ApilError, ConfigError, VictimError, reason_of
from apil_core.config.absent import read_stored
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.foreign.origin import Origin
from apil_core.training.adversary import AdversaryPolicy
from apil_core.training.build import adversary_policy

FORMAT = "apil-adversary-1"

_ODD = (AttributeError, LookupError, RuntimeError, TypeError, ValueError)
"""Errors caused by content of unexpected structure; JSON nested too deeply is a RuntimeError."""

_PARTS = ("groups", "builder", "methods", "observers", "learner")


def to_bytes(
    state: Mapping[str, Any], config: RunConfig, layout: GameLayout, side: int, provenance: Mapping[str, str]
) -> bytes:
    """The file's content.

    Args:
        state: of a checkpoint.
        config: the run's.
        layout: of its game.
        side: the adversary's.
        provenance: origin, as text.
    """
    actor = {"ppo": {"actor_state_dict": state["learner"]["ppo"]["actor_state_dict"]}}
    tensors: dict[str, Tensor] = {}
    tree = _take_out(
        {**{part: state[part] for part in _PARTS if part in state}, "learner": actor}, "state", tensors
    )
    metadata = {
        "format": FORMAT,
        "tensors_sha256": _tensors_sha256(tensors),
        "state": json.dumps(tree),
        "config": _shareable(config).model_dump_json(),
        "layout": json.dumps(_plain_layout(layout)),
        "side": str(side),
        "provenance": json.dumps(dict(provenance)),
    }
    return save(tensors, metadata)


def without_folders(name: str) -> str:
    """A policy's name without the folders of this machine, which are private."""
    scheme, _, rest = name.rpartition(":")
    path = Path(rest)
    if not path.is_absolute():
        return name
    kept = path.parts[-3:] if path.parent.name == "checkpoints" else path.parts[-1:]  # with the run's name
    return f"{scheme}:{'/'.join(kept)}" if scheme else "/".join(kept)


def _shareable(config: RunConfig) -> RunConfig:
    """The settings with paths that loading does not need cut to their last part, or removed."""
    return config.model_copy(
        update={
            "victim": without_folders(config.victim),
            "plugins": tuple(Path(file).name for file in config.plugins),
            "init_from": None,
        }
    )


def load_file(
    origin: Origin, *, seat: SideLayout | None, plugins: PluginRegistry, device: str
) -> AdversaryPolicy:
    """The adversary in a file.

    Args:
        origin: name, hash and path.
        seat: of the policy.
        plugins: registry with its method.
        device: of the networks.

    Raises:
        VictimError: the file is damaged, or made for another seat; or no plugin has its method.
    """
    try:
        with safe_open(origin.path, framework="pt") as file:
            metadata: dict[str, str] = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118  (no mapping)
        actual = _tensors_sha256(tensors)
        if metadata.get("tensors_sha256", actual) != actual:  # files from before 2026-12 have none
            raise ValueError(f"its tensors have SHA-256 {actual}, not {metadata['tensors_sha256']}")
        state = _put_back(json.loads(metadata["state"]), tensors)
        config = read_stored(json.loads(metadata["config"]), plugins, RunConfig)
        layout, side = _layout(json.loads(metadata["layout"])), ("0", "1").index(metadata["side"])
        trained = layout.sides[side]
        provenance = dict(json.loads(metadata["provenance"]))
    except (SafetensorError, OSError, *_ODD) as error:
        raise origin.wrong(f"a file of format {FORMAT}", f"a damaged one ({reason_of(error)})") from error
    if seat and seat.discrete:  # files from before unbounded scores have ±10
        trained = replace(trained, action_low=seat.action_low, action_high=seat.action_high)
    if seat not in (None, trained):
        raise ConfigError(f"{origin.name} is the {trained.name} of {config.env}; this is another seat")
    if config.method not in plugins.methods:
        raise VictimError(
            f"{origin.name} needs the plugin that offers method {config.method!r} (known: "
            f"{', '.join(sorted(plugins.methods))}); install it, or name its file with --plugin FILE"
        )
    sizes = trained.observation_size, trained.action_size
    bounds = (trained.action_low, trained.action_high)
    info = PolicyInfo(origin.name, origin.sha256, *sizes, provenance, bounds)
    config = config.model_copy(update={"device": device, "plugins": ()})
    try:
        with torch.random.fork_rng(devices=[]):
            policy = adversary_policy(state, info, config, layout, side, plugins, 0)
    except ApilError as error:
        raise VictimError(f"{origin.name}: {error}") from error
    except _ODD as error:
        raise origin.wrong(f"state that fits method {config.method!r}", reason_of(error)) from error
    if policy.hooks.implements("filter_observation"):
        raise ConfigError(f"{origin.name} filters what both sides see; it can only play from its run")
    return policy


def _tensors_sha256(tensors: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256()
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)} ".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def _take_out(value: Any, place: str, tensors: dict[str, Tensor]) -> Any:
    """``value`` as JSON, its tensors moved to ``tensors`` and named by their path."""
    if isinstance(value, Tensor):
        tensors[place] = value.detach().cpu().contiguous().clone()
        return {"tensor": place}
    if isinstance(value, Mapping):  # keys need not be strings: optimisers use integers
        pairs = [[key, _take_out(item, f"{place}.{key}", tensors)] for key, item in value.items()]
        return {"mapping": pairs}
    if isinstance(value, (list, tuple)):
        kind = "tuple" if isinstance(value, tuple) else "list"
        return {kind: [_take_out(item, f"{place}.{i}", tensors) for i, item in enumerate(value)]}
    return {"value": value}


def _put_back(tree: dict[str, Any], tensors: Mapping[str, Tensor]) -> Any:
    ((kind, content),) = tree.items()
    if kind == "tensor":
        return tensors[content]
    if kind == "mapping":
        return {key: _put_back(item, tensors) for key, item in content}
    if kind in ("list", "tuple"):
        items = [_put_back(item, tensors) for item in content]
        return tuple(items) if kind == "tuple" else items
    return content


def _plain_layout(layout: GameLayout) -> dict[str, Any]:
    plain = asdict(layout)
    for side in plain["sides"]:
        side["blocks"] = {name: [part.start, part.stop] for name, part in side["blocks"].items()}
    return plain


def _layout(plain: dict[str, Any]) -> GameLayout:
    first, second = (
        SideLayout(
            **{
                **side,
                "blocks": {name: slice(*ends) for name, ends in side["blocks"].items()},
                "opponent_channels": tuple(side["opponent_channels"]),
            }
        )
        for side in plain["sides"]
    )
    return GameLayout((first, second), plain["max_steps"], tuple(plain["causes"]))
