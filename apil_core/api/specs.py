"""Specs that plugins register: pure data, importable without torch or mujoco.

Factories are named as lazy ``"module:attribute"`` strings, so that ``apil --help`` and
``apil plugins`` stay quick; :func:`load` resolves one when it is needed.
"""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel

from apil_core.common.errors import PluginError


@dataclass(frozen=True)
class RewardWeights:
    """Weights that combine a game's dense and sparse rewards into the training reward (docs/methods.md §1).

    ``r = c * dense_weight * dense + (1 - c) * sparse_weight * sparse`` where ``c`` falls linearly
    from ``1`` to ``0`` over the first ``anneal_fraction`` of training (``0``: sparse from the start).
    """

    dense_weight: float = 0.1
    sparse_weight: float = 0.01
    anneal_fraction: float = 0.0


Reference = str | type
"""What a spec names: a lazy ``"module:attribute"``, or in a notebook the class itself."""


@dataclass(frozen=True)
class MethodSpec:
    """An attack method.

    Attributes:
        name: what ``--method`` takes.
        factory: ``"module:Class"``, or the class, of a :class:`apil_core.Method`.
        summary: one line for ``apil methods``.
        requires: methods whose hooks must be registered before this one's.
        config: ``"module:Model"``, or the class: the pydantic model of its options, or ``None``.
        hookspecs: ``"module"`` with ``@hookspec`` functions this method opens to others, or ``None``.
        reference: the paper.
        white_box: it, and what requires it, may see inside the victim (``run.victim``); stored with scores.
    """

    name: str
    factory: Reference
    summary: str = ""
    requires: tuple[str, ...] = ()
    config: Reference | None = None
    hookspecs: str | None = None
    reference: str = ""
    white_box: bool = False


@dataclass(frozen=True)
class ObserverSpec:
    """An observer: run hooks that are switched on beside a method, such as a defence of the victim.

    Attributes:
        name: what the key ``observers`` and ``apil eval --observer`` take.
        factory: ``"module:Class"``, or the class, of an :class:`apil_core.Observer`.
        summary: one line for ``apil observers``.
        config: ``"module:Model"``, or the class: the pydantic model of its options, or ``None``.
        reference: the paper.
    """

    name: str
    factory: Reference
    summary: str = ""
    config: Reference | None = None
    reference: str = ""


RunPluginSpec = MethodSpec | ObserverSpec
"""Spec of an object that is built for every run and may have a section of ``options``."""


def titled(spec: RunPluginSpec) -> str:
    """Name in messages, e.g. ``method 'apil'``."""
    return f"{'method' if isinstance(spec, MethodSpec) else 'observer'} {spec.name!r}"


def wanted_of(spec: RunPluginSpec) -> str:
    """Required return type of the factory, for messages."""
    return "a Method" if isinstance(spec, MethodSpec) else "an Observer"


@dataclass(frozen=True)
class PublishedScore:
    """Published result of a matchup, from the adversary's side.

    Attributes:
        win, win_or_tie: per cent.
        games: number of games behind them.
        source: citation.
        adversary_actions, victim_actions: ``"sample"`` or ``"mode"`` where the source or its code states
            it, else ``None``.
    """

    win: float
    win_or_tie: float
    games: int
    source: str
    adversary_actions: Literal["sample", "mode"] | None = None
    victim_actions: Literal["sample", "mode"] | None = None


@dataclass(frozen=True)
class Matchup:
    """Two named policies whose games measure how close a game is to its original (``apil fidelity``).

    Attributes:
        adversary, victim: policy names.
        published: the score to compare with, or ``None`` if there is none.
        stands_in_for: name of the adversary ``published`` was measured with, if that is another one. Such
            a matchup is played only while the weights of that one are missing.
    """

    adversary: str
    victim: str
    published: PublishedScore | None = None
    stands_in_for: str | None = None


@dataclass(frozen=True)
class GameSpec:
    """A two-player game.

    Attributes:
        name: what ``--env`` takes.
        factory: ``"module:callable"``; called as ``factory(num_envs=, threads=, options=)`` and
            returns a :class:`apil_core.Game`. ``options`` is an instance of ``config`` (or ``None``).
        summary: one line for ``apil games``.
        sides: names of side 0 and side 1.
        victim_side: index of the side that is attacked by default.
        default_victim: policy name used when none is given, e.g. ``"zoo:kick-and-defend/kicker/v1"``.
        fallback_victim: used instead where that one's weights are not on this machine, or ``""``.
        baseline_adversary: policy name of the agent the adversary is compared with, or ``None``.
        rewards: default weights of the training reward.
        config: ``"module:Model"``, the pydantic model of the game's options, or ``None``.
        family: ``name`` is a scheme: every ``<name>:<target>`` is a game, with this spec and that target.
        target: passed to the factory as ``target=`` if not empty: selects one game of a family.
        matchups: what ``apil fidelity`` plays.
        interchangeable_sides: both sides have the same observations and actions; an agent can play either.
    """

    name: str
    factory: str
    summary: str = ""
    sides: tuple[str, str] = ("player_0", "player_1")
    victim_side: Literal[0, 1] = 0
    default_victim: str = ""
    fallback_victim: str = ""
    baseline_adversary: str | None = None
    rewards: RewardWeights = RewardWeights()
    config: str | None = None
    family: bool = False
    target: str = ""
    matchups: tuple[Matchup, ...] = ()
    interchangeable_sides: bool = False

    @property
    def label(self) -> str:
        """Name in listings: a family's with an ellipsis, as its name alone is no game."""
        return f"{self.name}:…" if self.family else self.name


@dataclass(frozen=True)
class PolicySpec:
    """A family of policies: everything named ``<scheme>:...``.

    Attributes:
        scheme: the part before the colon.
        loader: ``"module:callable"``; called as ``loader(name)`` with the part after the colon,
            returns a :class:`apil_core.Policy` on the CPU or raises :class:`apil_core.VictimError`.
        lister: ``"module:callable"`` returning ``list[PolicyListing]``, or ``None``.
        summary: one line.
        seat: the loader also gets ``seat=``, the :class:`apil_core.SideLayout` the policy is wanted for,
            or ``None`` where that is not known; for formats that do not state their own sizes.
        plugins: the loader also gets ``plugins=`` (a registry) and ``device=`` and puts the policy there;
            for policies that are made of methods.
        runs_code: loading runs user code: refused unless trusted.
        file: the part after the colon names a file or directory.
    """

    scheme: str
    loader: str
    lister: str | None = None
    summary: str = ""
    seat: bool = False
    plugins: bool = False
    runs_code: bool = False
    file: bool = False


@dataclass(frozen=True)
class PolicyListing:
    """One row of ``apil victims list``."""

    name: str
    available: bool
    sha256: str = ""
    provenance: str = ""


@dataclass(frozen=True)
class RecorderSpec:
    """A sink of metrics.

    Attributes:
        name: what the key ``recorders`` takes.
        factory: ``"module:callable"``; called with the run directory, returns an object with
            ``record(metrics)`` and ``close()``, see :class:`apil_core.training.storage.metrics_log.Recorder`.
        summary: one line.
        check: ``"module:callable"`` or empty; called before anything is built, raises
            :class:`apil_core.ApilError` if the recorder cannot work here.
    """

    name: str
    factory: str
    summary: str = ""
    check: str = ""


@contextmanager
def foreign_code() -> Iterator[None]:
    """Context for importing third-party code: its stdout goes to stderr, its exits become ``Exception``."""
    try:
        with redirect_stdout(sys.stderr):  # stdout is for results
            yield
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:  # sys.exit in a script that was never meant to be imported
        reason = " ".join(str(error).split()) or "no message"
        raise PluginError(f"{type(error).__name__}: {reason}") from error


def load(reference: Reference, whose: str = "") -> Any:
    """Resolve ``"module:attribute"`` (or ``"module"``).

    Args:
        reference: what to load; a class is returned as it is.
        whose: start of the error message, e.g. ``"method 'apil'"``.

    Raises:
        PluginError: the module does not import or has no such attribute.
    """
    if not isinstance(reference, str):
        return reference
    module_name, _, attribute = reference.partition(":")
    try:
        with foreign_code():
            module = importlib.import_module(module_name)
            return getattr(module, attribute) if attribute else module
    except Exception as error:
        reason = " ".join(f"{error}".split()) or type(error).__name__
        asked = f"{whose}: " if whose else ""
        raise PluginError(f"{asked}cannot load {reference!r}: {reason}{_graphics_hint(error)}") from error


def _graphics_hint(error: BaseException) -> str:
    """Hint on an import error of MuJoCo, which loads ``MUJOCO_GL``'s OpenGL on import; ``""`` for others."""
    asked = os.environ.get("MUJOCO_GL")
    frames = traceback.extract_tb(error.__traceback__)
    if not asked or not any("mujoco" in frame.filename for frame in frames):
        return ""
    return f" (MUJOCO_GL is set to {asked!r}: install that OpenGL, or unset it)"


def options_model(reference: Reference, whose: str = "") -> type[BaseModel]:
    """The pydantic model a spec names.

    Args:
        reference: as the spec has it.
        whose: start of the error message, e.g. ``"method 'apil'"``.

    Raises:
        PluginError: it cannot be loaded or is no pydantic model.
    """
    model = load(reference, whose)
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        what = model.__name__ if isinstance(model, type) else type(model).__name__
        asked = f"{whose}: " if whose else ""
        raise PluginError(f"{asked}{reference} must be a pydantic model, got {what}")
    return model
