"""``python:MODULE:CALLABLE``: a policy from user code, which loading and acting execute."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import torch

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, View
from apil_core.common.errors import ApilError, VictimError, failures, reason_of
from apil_core.common.files import sha256
from apil_core.policies.foreign.network import NetworkPolicy, Signature
from apil_core.policies.foreign.origin import Origin


def load(name: str, *, seat: SideLayout | None) -> Policy:
    """The object that the callable returns, or the callable itself.

    A callable whose first parameter is called ``seat`` is called once with the
    :class:`apil_core.SideLayout` and returns a :class:`apil_core.Policy`, or a function. A function is
    called with observations (n, o) and returns actions (n, a), or mean and log standard deviation.

    Raises:
        VictimError: there is no such callable, or it fails.
    """
    module_name, _, attribute = name.partition(":")
    if not module_name or not attribute:
        raise VictimError(f"python:{name}: expected python:MODULE:CALLABLE, e.g. python:agents:make_kicker")
    target = _found(name, module_name, attribute)
    file = Path(str(getattr(sys.modules[module_name], "__file__", None) or module_name))
    origin = Origin(f"python:{name}", sha256(file) if file.is_file() else "", file)
    made = _guarded(origin, "failed", lambda: target(seat)) if _wants_seat(target) else target
    if isinstance(made, Policy):
        return UserPolicy(made, origin, seat)
    if not callable(made):
        raise origin.wrong("a Policy, or a function from observations to actions", f"{type(made).__name__}")
    return NetworkPolicy(
        origin, lambda inputs: _guarded(origin, "failed", lambda: made(*inputs)), Signature(), seat
    )


def _found(name: str, module_name: str, attribute: str) -> Any:
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)  # appended: user files must not shadow libraries imported later
    try:
        with redirect_stdout(sys.stderr):  # stdout is for results
            target = attrgetter(attribute)(importlib.import_module(module_name))
    except ApilError:
        raise
    except failures() as error:
        where = getattr(sys.modules.get(module_name), "__file__", None) or f"looked in {here} too"
        raise VictimError(f"python:{name}: {module_name} ({where}): {reason_of(error)}") from error
    if not callable(target):
        raise VictimError(f"python:{name}: expected something callable, found {type(target).__name__}")
    return target


def _wants_seat(target: Any) -> bool:
    try:
        return next(iter(inspect.signature(target).parameters), "") == "seat"
    except (TypeError, ValueError):  # built in
        return False


def _guarded(origin: Origin, what: str, call: Callable[[], Any]) -> Any:
    """Call user code; any exception becomes a one-line error with the policy's name."""
    try:
        with redirect_stdout(sys.stderr):
            return call()
    except ApilError:
        raise
    except failures() as error:
        raise VictimError(
            f"{origin.name} {what}: {reason_of(error)} (APIL_DEBUG=1 shows the traceback)"
        ) from error


class UserPolicy(Policy):
    """A user's policy, with a name, a hash, and its errors attributed to it."""

    def __init__(self, policy: Policy, origin: Origin, seat: SideLayout | None):
        self._policy = policy
        self._origin = origin
        theirs: PolicyInfo | None = getattr(policy, "info", None)
        if theirs is None:
            if seat is None:
                raise VictimError(f"{origin.name}: its Policy has no info, and its seat is not known")
            theirs = PolicyInfo(origin.name, origin.sha256, seat.observation_size, seat.action_size)
        self.info = replace(theirs, name=origin.name, sha256=origin.sha256)

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`."""
        ask = self._policy.act
        decision: Decision = _guarded(
            self._origin,
            "failed in act",
            lambda: ask(view, sample=sample, generator=generator, activations=activations),
        )
        return decision

    def to(self, device: torch.device | str) -> UserPolicy:
        """Move it; returns self."""
        self._policy = _guarded(self._origin, "failed in to", lambda: self._policy.to(device))
        return self

    def seed(self, seed: int) -> None:
        """See :meth:`apil_core.Policy.seed`."""
        _guarded(self._origin, "failed in seed", lambda: self._policy.seed(seed))

    def recurrent_state(self) -> dict[str, Any]:
        """See :meth:`apil_core.Policy.recurrent_state`."""
        state: dict[str, Any] = _guarded(
            self._origin, "failed in recurrent_state", self._policy.recurrent_state
        )
        return state

    def load_recurrent_state(self, state: dict[str, Any]) -> None:
        """See :meth:`apil_core.Policy.load_recurrent_state`."""
        _guarded(
            self._origin, "failed in load_recurrent_state", lambda: self._policy.load_recurrent_state(state)
        )
