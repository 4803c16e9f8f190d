"""Export of a run's adversary as one file that other programs, or ``apil`` itself, can load.

ONNX and TorchScript files contain everything from raw observations to the action's distribution:
methods' modules (APIL's imitator), normalisation, actor. Inputs besides the own observation (the
opponent's, for APIL) are further inputs of the network, named in the file's signature.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from importlib import metadata
from os import PathLike, fspath
from pathlib import Path
from typing import Literal

import torch

from apil_core.api.game import Game
from apil_core.api.method import RunPlugin
from apil_core.api.policy import Policy
from apil_core.api.types import View
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.extras import need
from apil_core.common.files import write_atomically
from apil_core.common.seeds import stream_seed
from apil_core.config.absent import completed
from apil_core.games.two_players import TwoPlayerGames
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import load_policy, make_game, plugins_with
from apil_core.policies.loading import victim_side
from apil_core.training.export.adversary_file import to_bytes, without_folders
from apil_core.training.export.run_policy import RunCheckpoint, run_path
from apil_core.training.export.traced_network import onnx_bytes, torchscript_bytes, trace
from apil_core.training.storage import checkpoint

Format = Literal["onnx", "torchscript", "safetensors"]

SUFFIXES: Mapping[Format, str] = {"onnx": ".onnx", "torchscript": ".pt", "safetensors": ".safetensors"}
TOLERANCE = 1e-5
"""Largest difference between the run's actions and the file's."""

_GAMES, _STEPS = 8, 32


@dataclass(frozen=True)
class Exported:
    """An exported file.

    Attributes:
        file: its path.
        name: by which ``apil`` loads it.
        sha256: of the file.
        reads: inputs of the network, in order; empty for safetensors.
        difference: largest deviation from the run's mean actions on observations of real games.
        provenance: as stored in the file.
    """

    file: Path
    name: str
    sha256: str
    reads: tuple[str, ...]
    difference: float
    provenance: dict[str, str]


def export(
    run: PathLike[str] | str,
    format: Format,
    out: Path | str | None = None,
    *,
    checkpoint_path: Path | None = None,
    plugin_files: tuple[str, ...] = (),
    force: bool = False,
) -> Exported:
    """Write the adversary of a run to a file, load the file again, and compare the two in real games.

    Args:
        run: its directory.
        format: ``"onnx"``, ``"torchscript"`` or ``"safetensors"``.
        out: the file; default: ``adversary`` with the format's suffix, in the run's directory.
        checkpoint_path: take this checkpoint rather than the newest.
        plugin_files: further one-file plugins.
        force: replace the file if it exists.

    Raises:
        ApilError: there is no such run, the file exists, the run cannot be expressed in that format, or the
            file's actions differ from the run's (the file is then deleted).
    """
    path = run_path(fspath(run))
    if path is None:
        raise ConfigError(f"{run} is no run directory; apil export takes what `apil run` wrote")
    source = RunCheckpoint.find(path, checkpoint_path)
    out = Path(out or source.run_dir.path / f"adversary{SUFFIXES[format]}").absolute()
    if out.is_dir() or not out.parent.is_dir():
        raise ConfigError(
            f"--out {out}: {'is a directory' if out.is_dir() else f'no directory {out.parent}'}"
        )
    if out.exists() and not force:
        raise ConfigError(f"{out} exists already; choose another --out, or --force to replace it")
    return write(source, format, out, plugins_with([*source.run_dir.config().plugins, *plugin_files]))


def write(
    source: RunCheckpoint,
    format: Format,
    out: Path,
    plugins: PluginRegistry,
    provenance: Mapping[str, str] = {},
) -> Exported:
    """:func:`export` of a checkpoint with these plugins; replaces ``out``. ``provenance`` is stored, too.

    Raises:
        ApilError: as :func:`export`.
    """
    if format == "onnx":
        need("onnxruntime")  # used to compare the actions
    config = completed(source.run_dir.config().model_copy(update={"device": "cpu"}), plugins)
    side = 1 - victim_side(config, plugins)
    game = make_game(config.env, num_envs=_GAMES, threads=1, options=config.game, plugins=plugins)
    with closing(game):
        layout, seat, views = game.layout, game.layout.sides[side], _views(game, side)
        policy, steps = source.policy(config, layout, plugins, 0, "run")
        provenance = {
            "run": source.run_dir.path.absolute().name,  # the rest of the path is private
            "checkpoint": source.path.name,
            "checkpoint_sha256": policy.info.sha256,
            "steps": str(steps),
            "seed": str(config.seed),
            "method": config.method,
            "game": config.env,
            "side": seat.name,
            **_physics(game),
            "victim": without_folders(config.victim),
            "apil": metadata.version("apil"),
            "torch": metadata.version("torch"),
            **provenance,
        }
    if policy.hooks.implements("filter_observation"):
        raise ConfigError(f"{source.run_dir.path} filters what both sides see; it can only play from its run")
    reads: tuple[str, ...] = ()
    if format == "safetensors":
        state = checkpoint.read(source.path)
        with policy.hooks.attribution():
            acting = {name: each.acting_state_dict() for name, each in policy.hooks.of(RunPlugin).items()}
        for kind in ("methods", "observers"):
            state[kind] = {name: acting.get(name, full) for name, full in state.get(kind, {}).items()}
        content = to_bytes(state, config, layout, side, provenance)
    else:
        traced = trace(policy, seat, views[0], provenance)
        reads = traced.signature.reads
        content = onnx_bytes(traced) if format == "onnx" else torchscript_bytes(traced)
    part = out.with_name(f".{out.name}.part")
    write_atomically(part, lambda file: file.write(content))
    try:
        written = load_policy(f"{format}:{part}", plugins=plugins, seat=seat)
        difference = _difference(policy, written, views, source.path, config.method)
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)
    digest = hashlib.sha256(content).hexdigest()
    return Exported(out, f"{format}:{out}", digest, reads, difference, provenance)


def _difference(policy: Policy, written: Policy, views: list[View], path: Path, method: str) -> float:
    """Largest deviation of the mode over the views.

    Raises:
        ApilError: it is more than rounding explains, or no number.
    """
    differences = []
    for view in views:
        ours, theirs = (who.act(view, sample=False) for who in (policy, written))
        pairs = [(ours.action, theirs.action)]
        if ours.distribution is not None and theirs.distribution is not None:
            std = [who.distribution.std.expand_as(who.action) for who in (ours, theirs)]  # type: ignore
            pairs.append((std[0], std[1]))
        if not all(expected.isfinite().all() for expected, _ in pairs):
            raise ApilError(
                f"the actions of {path} are not finite: its training diverged; "
                "choose an earlier one with --checkpoint"
            )
        differences += [(a - b).abs().max() for a, b in pairs]
    largest = float(torch.stack(differences).max())  # NaN if one is, unlike Python's max
    if not largest <= TOLERANCE:
        raise ApilError(
            f"the exported file does not act as the run does (difference {largest:.2g}, allowed "
            f"{TOLERANCE:g}): method {method!r} does in its hooks what a fixed network "
            "cannot, e.g. remembers or draws; use --format safetensors"
        )
    return largest


def _physics(game: Game) -> dict[str, str]:
    """``physics: fast, solver Newton, …`` for a game with profiles."""
    if not game.settings:
        return {}
    values = [f"{key} {value}" for key, value in game.settings.items() if key != "physics"]
    return {"physics": ", ".join([str(game.settings.get("physics")), *values])}


def _views(game: Game, side: int) -> list[View]:
    """Views of the adversary in real games in which both sides act at random."""
    generator = torch.Generator().manual_seed(stream_seed(0, "export"))
    game.seed(stream_seed(0, "export games"))
    games, views = TwoPlayerGames(game), []
    games.reset()
    for _ in range(_STEPS):
        sizes = enumerate(seat.action_size for seat in game.layout.sides)
        actions = {i: torch.randn(game.num_envs, size, generator=generator) for i, size in sizes}
        view = games.view(side, actions[1 - side])
        views.append(View(view.own.clone(), view.opponent.clone(), view.first, view.opponent_action))
        games.reset(games.step(actions).done)
    return views
