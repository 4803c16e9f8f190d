"""How close a game is to its original: measured scores beside published ones.

A verdict here is a statement about noise: whether the difference of two shares could be chance. It is
none about whether the physics, the rules or the published figure are right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from typing import TYPE_CHECKING

from apil_core.common.errors import UnknownNameError, VictimError
from apil_core.evaluation.fidelity.plan import RowPlan
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import evaluate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import load_policy

if TYPE_CHECKING:
    from apil_core.evaluation.fidelity.rows import FidelityFile
from apil_core.evaluation.fidelity.rows import FidelityRow


def missing_policy(plugins: PluginRegistry) -> Callable[[str], str | None]:
    """Why a policy cannot be played here, by its name; ``None`` if it can."""

    def reason(name: str) -> str | None:
        try:
            load_policy(name, plugins=plugins)
        except (VictimError, UnknownNameError) as error:
            return str(error)
        return None

    return reason


def play_rows(
    plans: Iterable[RowPlan],
    *,
    plugins: PluginRegistry,
    threads: int = 0,
    progress: Progress | None = None,
    file: FidelityFile | None = None,
) -> list[FidelityRow]:
    """Play every row that ``file`` does not have yet, keeping each as soon as it is finished.

    Args:
        plans: in the order of playing.
        plugins: know the games and the policies.
        threads: physics threads (0: all CPUs); never changes the result.
        progress: told of the games played and of each finished row.
        file: where rows are kept and taken from.

    Raises:
        ApilError: anything wrong with names, options or the file.
    """
    plans = list(plans)
    progress = progress or Progress()
    with nullcontext() if file is None else file.alone():
        rows = {} if file is None else file.played(plans, plugins)
        for plan in plans:
            if plan.identity in rows:
                continue
            row = FidelityRow(plan=plan, result=_play(plan, plugins, threads, progress))
            if file is not None:
                file.add(row)
            rows[plan.identity] = row
            progress.note(f"{len(rows)} of {len(plans)} rows: {summary(row)}")
    return [rows[plan.identity] for plan in plans]


def _play(plan: RowPlan, plugins: PluginRegistry, threads: int, progress: Progress) -> EvaluationResult:
    return evaluate(
        plan.adversary,
        env=plan.env,
        victim=plan.victim,
        episodes=plan.episodes,
        adversary_actions=plan.adversary_actions,
        victim_actions=plan.victim_actions,
        game_options=plan.options,
        seed=plan.seed,
        num_envs=plan.num_envs,
        threads=threads,
        plugins=plugins,
        progress=progress,
    )


def summary(row: FidelityRow) -> str:
    """One line: the row, its shares, and the verdicts if there are any."""
    win, either = (100 * figure.measured.value for figure in (row.win, row.win_or_tie))
    text = f"{row.plan.title}: {win:.1f} % wins, {either:.1f} % wins and ties"
    verdicts = [figure.verdict for figure in (row.win, row.win_or_tie) if figure.verdict]
    return f"{text} ({'; '.join(verdicts)})" if verdicts else text
