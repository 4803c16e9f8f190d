"""Comparison of a game's measured scores with published ones.

A verdict concerns sampling noise only: whether the difference of two shares could be chance. It does not
concern the correctness of the physics, the rules or the published figure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from pathlib import Path

from apil_core.common.errors import UnknownNameError, VictimError
from apil_core.common.files import check_place, locked_for
from apil_core.evaluation.fidelity.plan import RowPlan
from apil_core.evaluation.fidelity.rows import FidelityRow, check_same, read_rows, write_rows
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.score import evaluate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import load_policy

_ASKED = {"adversary", "victim", "env", "episodes", "adversary_actions", "victim_actions", "seed", "num_envs"}
"""Fields of a plan that are arguments of an evaluation."""


def missing_policy(plugins: PluginRegistry) -> Callable[[str], str | None]:
    """Function from a policy's name to the reason why it cannot be played here, or ``None``."""

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
    out: Path | None = None,
) -> list[FidelityRow]:
    """Play every row that the file ``out`` does not have yet; each is written as soon as it is finished.

    Args:
        plans: in the order of playing.
        plugins: registry with the games and the policies.
        threads: physics threads (0: all CPUs); never changes the result.
        progress: called as games end, and with a note of each finished row.
        out: file that rows are read from and written to.

    Raises:
        ApilError: names, options or the file are wrong.
    """
    plans = list(plans)
    progress = progress or Progress()
    if out is not None:
        check_place(out)
    with nullcontext() if out is None else locked_for(out, "apil fidelity"):
        stored = [] if out is None or not out.exists() else read_rows(out)
        here, rows = {row.plan.identity: row for row in stored}, {}
        for plan in plans:
            if out is not None and plan.identity in here:
                check_same(out, plan, here[plan.identity], plugins)
                # the published score may have been corrected since; the games are unchanged
                rows[plan.identity] = here[plan.identity].model_copy(update={"plan": plan})
        for plan in plans:
            if plan.identity in rows:
                continue
            asked = plan.model_dump(include=_ASKED) | {"game_options": plan.options}
            score = evaluate(**asked, threads=threads, plugins=plugins, progress=progress)
            row = FidelityRow(plan=plan, result=score)
            stored.append(row)
            if out is not None:
                write_rows(out, stored)
            rows[plan.identity] = row
            progress.note(f"{len(rows)} of {len(plans)} rows: {summary(row)}")
    return [rows[plan.identity] for plan in plans]


def summary(row: FidelityRow) -> str:
    """One line: the row, its shares, and the verdicts if there are any."""
    win, either = (100 * figure.measured.value for figure in (row.win, row.win_or_tie))
    text = f"{row.plan.title}: {win:.1f} % wins, {either:.1f} % wins and ties"
    verdicts = [figure.verdict for figure in (row.win, row.win_or_tie) if figure.verdict]
    return f"{text} ({'; '.join(verdicts)})" if verdicts else text
