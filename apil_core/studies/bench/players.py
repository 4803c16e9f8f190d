"""Load every policy that a benchmark names before it starts, so that errors do not come hours later."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

from apil_core.api.specs import load
from apil_core.common.errors import ApilError, ConfigError
from apil_core.evaluation.results import PolicyId
from apil_core.studies.bench.cells import Benchmark, Cell, resolve_matrix
from apil_core.studies.bench.folder import BenchDir


def with_full_names(benchmark: Benchmark, origin: str) -> Benchmark:
    """Return the benchmark with its victims' and adversaries' full names, as runs and scores store them.

    Args:
        benchmark: resolved; every victim, baseline and adversary in it is loaded and put into its seat.
        origin: the matrix's name in messages.

    Raises:
        ApilError: a policy cannot be loaded, does not fit, or cannot be retrained as the matrix asks; a
            library that a stage needs is missing.
    """
    from apil_core.common.extras import need

    matrix, plugins = benchmark.matrix, benchmark.plugins
    for name in sorted({name for cell in benchmark.cells for name in cell.config.recorders}):
        if plugins.recorders[name].check:
            load(plugins.recorders[name].check)()
    if any(matrix.has("activations", game) for game in benchmark.baselines):
        need("sklearn", "matplotlib")
    victims, named = {}, {}
    hashes: dict[str, str] = {}
    for game in matrix.games:
        cells = {cell.victim: cell for cell in reversed(benchmark.cells_of(game))}
        victims[game] = tuple(_full_name(benchmark, cells[name], origin) for name in matrix.victims[game])
    for game, adversaries in matrix.adversaries.items():
        cell = benchmark.cells_of(game)[0]
        found = {
            label: _adversary(benchmark, cell, label, name, origin) for label, name in adversaries.items()
        }
        named[game] = {label: each.name for label, each in found.items()}
        hashes |= {each.name: each.sha256 for each in found.values()}
    if victims != matrix.victims or named != matrix.adversaries:
        pinned = matrix.model_copy(update={"victims": victims, "adversaries": named}, deep=True)
        benchmark = resolve_matrix(pinned, origin)
    return replace(benchmark, hashes=hashes)


def _adversary(benchmark: Benchmark, cell: Cell, label: str, name: str, origin: str) -> PolicyId:
    """Full name and hash of an adversary of the matrix, loaded into its seat of that cell's game."""
    from apil_core.evaluation.options import EvaluationOptions
    from apil_core.evaluation.pairing import load_pairing
    from apil_core.studies.bench.work import in_games_of

    try:
        options = in_games_of(cell.config, name, EvaluationOptions(), benchmark.plugins)
        with load_pairing(name, options, num_envs=1) as pairing:
            if pairing.config.observers:
                raise ConfigError(f"{name} was trained with observers, which the matrix's scores are without")
            return PolicyId.of(pairing.adversary.info)
    except ApilError as error:
        raise ConfigError(f"{origin}, adversaries.{cell.game}.{label}: {error}") from error


def check_same_adversaries(bench: BenchDir, benchmark: Benchmark) -> None:
    """Check that the matrix's adversaries have the weights with which they were scored.

    Raises:
        ConfigError: one has others.
    """
    for game, named in benchmark.matrix.adversaries.items():
        for label, name in named.items():
            for victim in benchmark.matrix.victims[game]:
                scores = (
                    bench.adversary(game, each, victim, label) for each in benchmark.matrix.scores_of(game)
                )
                for then in (score.adversary for score in scores if score is not None):
                    if then.name == name and then.sha256 != benchmark.hashes[name]:
                        raise ConfigError(
                            f"adversaries.{game}.{label}: {name} has changed since it was scored: SHA-256 "
                            f"was {then.sha256}, is {benchmark.hashes[name]}; give the new one another label"
                        )


def _full_name(benchmark: Benchmark, cell: Cell, origin: str) -> str:
    from apil_core.plugins.registry import make_game
    from apil_core.policies.loading import LoadOptions, load_victim, victim_side
    from apil_core.runs.retraining.build import prepare
    from apil_core.studies.bench.stages import retraining_of

    config, plugins = cell.config, benchmark.plugins
    baseline = benchmark.baselines.get(cell.game)
    try:
        game = make_game(cell.game, num_envs=1, options=config.game, plugins=plugins)
        with closing(game):
            side, load_options = victim_side(config, plugins), LoadOptions(config.trust)
            victim = load_victim(cell.victim, game, side, "cpu", plugins, load_options)
            if baseline is not None:
                load_victim(baseline, game, 1 - side, "cpu", plugins, load_options)
        if baseline is not None and benchmark.matrix.has("retraining", cell.game):
            # all that a retraining could be refused for, before anything is trained
            here = {"env": cell.game, "victim": victim.info.name, "game": config.game}
            prepare(retraining_of(benchmark, cell, baseline, **here), plugins).close()
    except ApilError as error:
        raise ConfigError(f"{origin}, {cell.game} against {cell.victim}: {error}") from error
    return victim.info.name
