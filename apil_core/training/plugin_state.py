"""States of methods and observers for checkpoints, checked before training starts; errors name the plugin."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from apil_core.common.errors import ApilError, PluginError, failures
from apil_core.common.seeds import undisturbed
from apil_core.training.storage.checkpoint import to_tensors

if TYPE_CHECKING:
    from apil_core.api.method import RunPlugin

_PLAIN = (Tensor, nn.Parameter, int, float, bool, str, bytes, type(None))
"""Types that are stored and loaded unchanged."""


def states_of(plugins: Mapping[str, RunPlugin]) -> dict[str, dict[str, Any]]:
    """``state_dict()`` of each plugin, by name.

    Raises:
        PluginError: one fails, is no dict, or holds what a checkpoint cannot hold; names plugin and key.
    """
    states = {}
    for name, plugin in plugins.items():
        try:
            state = plugin.state_dict()
        except ApilError:
            raise
        except failures() as error:
            raise PluginError(f"plugin {name!r} failed in state_dict: {_reason(error)}") from error
        if not isinstance(state, dict):
            raise PluginError(f"plugin {name!r}: state_dict must return a dict, got {type(state).__name__}")
        culprit = unstorable(state, "state_dict")
        if culprit is not None:
            where, what = culprit
            raise PluginError(
                f"plugin {name!r}: {where} is a {what}, which a checkpoint cannot hold; "
                "give tensors, numbers, strings and dicts of them"
            )
        states[name] = state
    return states


def load_states(plugins: Mapping[str, RunPlugin], states: Mapping[str, dict[str, Any]]) -> None:
    """Load into each plugin what :func:`states_of` gave.

    Raises:
        PluginError: one cannot load it.
    """
    for name, plugin in plugins.items():
        if name not in states:
            raise PluginError(
                f"plugin {name!r}: the checkpoint has no state of it; it was written without it"
            )
        try:
            plugin.load_state_dict(states[name])
        except ApilError:
            raise
        except failures() as error:
            raise PluginError(f"plugin {name!r}: its state does not load back: {_reason(error)}") from error


def load_known_states(plugins: Mapping[str, RunPlugin], states: Mapping[str, dict[str, Any]]) -> None:
    """:func:`load_states` for plugins with a stored state; the others keep their initial state."""
    load_states({name: plugin for name, plugin in plugins.items() if name in states}, states)


def of_other_games(saved: Any, fresh: Any, there: int, here: int) -> Any:
    """``saved`` with the ``fresh`` value of what has a row for each of ``there`` games, not for ``here``.

    A plugin that makes it in its first step has none or ``None`` yet.
    """
    if isinstance(saved, Mapping) and isinstance(fresh, Mapping):
        return {k: of_other_games(v, fresh[k], there, here) if k in fresh else v for k, v in saved.items()}
    if isinstance(saved, Tensor) and isinstance(fresh, Tensor) and saved.shape != fresh.shape:
        per_game = [here if a == there and b == here else a for a, b in zip(saved.shape, fresh.shape)]  # noqa: B905
        return fresh if tuple(per_game) == fresh.shape else saved
    lazy = fresh is None and isinstance(saved, Tensor) and there != here and there in saved.shape[:1]
    return None if lazy else saved


def check_states(
    plugins: Mapping[str, RunPlugin], anew: Callable[[], Mapping[str, RunPlugin]], device: torch.device
) -> None:
    """Check that states can be stored and loaded into newly built objects; draws no random numbers.

    Args:
        plugins: of a run, just built.
        anew: builds them again.
        device: of the plugins.

    Raises:
        PluginError: a state cannot be stored or loaded.
    """
    states = states_of(plugins)
    if not any(states.values()):
        return
    with undisturbed(device):
        load_states(anew(), stored_and_read(states))


def stored_and_read(states: Mapping[str, Any]) -> dict[str, Any]:
    """``states`` as loaded from a checkpoint."""
    file = io.BytesIO()
    torch.save(to_tensors(states), file)
    file.seek(0)
    read: dict[str, Any] = torch.load(file, weights_only=True)
    return read


def unstorable(value: Any, path: str) -> tuple[str, str] | None:
    """Find the first value below ``path`` that a checkpoint cannot hold: its place and its type."""
    if isinstance(value, Tensor) and value.grad_fn is not None:
        return path, "tensor with a graph"
    if type(value) in _PLAIN:
        return None
    if isinstance(value, (np.ndarray, np.generic)):  # it would be loaded as a tensor, or a plain number
        return path, "numpy array" if isinstance(value, np.ndarray) else "numpy number"
    if isinstance(value, Mapping):
        inner = [(f"{path}[{key!r}]", item) for key, item in value.items()]
        inner += [(f"{path}: key {key!r}", key) for key in value if type(key) not in _PLAIN]
    elif type(value) in (list, tuple):
        inner = [(f"{path}[{i}]", item) for i, item in enumerate(value)]
    else:
        return None if _survives(value) else (path, type(value).__name__)
    found = (unstorable(item, where) for where, item in inner)
    return next((culprit for culprit in found if culprit is not None), None)


def _survives(value: Any) -> bool:
    try:
        stored_and_read({"": value})
    except Exception:  # any exception of a third-party class while it is pickled
        return False
    return True


def _reason(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
