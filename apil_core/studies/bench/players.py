"""Load every policy that a benchmark names before it starts, so that errors do not come hours later."""

from __future__ import annotations

from contextlib import closing

from apil_core.api.specs import load
from apil_core.common.errors import ApilError, ConfigError
from apil_core.studies.bench.cells import Benchmark, Cell, resolve_matrix


def with_full_names(benchmark: Benchmark, origin: str) -> Benchmark:
    """Return the benchmark with its victims' full names, as runs and scores store them.

    Args:
        benchmark: resolved; every victim and baseline in it is loaded and put into its seat.
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
    victims = {}
    for game in matrix.games:
        cells = {cell.victim: cell for cell in reversed(benchmark.cells_of(game))}
        victims[game] = tuple(_full_name(benchmark, cells[name], origin) for name in matrix.victims[game])
    if victims == matrix.victims:
        return benchmark
    return resolve_matrix(matrix.model_copy(update={"victims": victims}, deep=True), origin)


def _full_name(benchmark: Benchmark, cell: Cell, origin: str) -> str:
    from apil_core.plugins.registry import make_game
    from apil_core.policies.loading import LoadOptions, load_victim, victim_side
    from apil_core.runs.retraining.trainable import trainable

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
                trainable(victim)
    except ApilError as error:
        raise ConfigError(f"{origin}, {cell.game} against {cell.victim}: {error}") from error
    return victim.info.name
