"""Finished rows of ``apil fidelity`` on disk, as they take hours to compute."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from pydantic import BaseModel, ValidationError, computed_field

from apil_core.common.errors import ConfigError
from apil_core.common.files import write_atomically
from apil_core.common.statistics import Difference, difference
from apil_core.config.game import spelt_out
from apil_core.evaluation.fidelity.plan import RowPlan
from apil_core.evaluation.results import EvaluationResult, Rate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import load_policy

_NUMBERS = ("episodes", "seed", "num_envs")


def read_rows(path: Path) -> list[FidelityRow]:
    """The rows of a file that ``apil fidelity --out`` wrote, one JSON object per line.

    Raises:
        ConfigError: it is not there, or a line is no row.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no such file")
    rows = []
    for number, line in enumerate(path.read_text("utf-8").splitlines(), start=1):
        try:
            rows.append(FidelityRow.model_validate_json(line))
        except ValidationError as error:
            raise ConfigError(f"{path}:{number}: this line is no row of apil fidelity") from error
    return rows


def write_rows(path: Path, rows: Iterable[FidelityRow]) -> None:
    """Write the file, whole or not at all.

    Raises:
        RunDirError: the file cannot be written; its contents are unchanged.
    """
    computed = {"win", "win_or_tie"}
    text = "".join(f"{row.model_dump_json(exclude=computed)}\n" for row in rows)
    write_atomically(path, lambda file: file.write(text.encode()))


def check_same(path: Path, plan: RowPlan, row: FidelityRow, plugins: PluginRegistry) -> None:
    """Compare everything that the numbers of a row in a file depend on with a plan.

    Raises:
        ConfigError: it was played with other settings than requested now.
    """
    result, policies = row.result, (plan.adversary, plan.victim)
    hashes = [load_policy(name, plugins=plugins).info.sha256 for name in policies]
    here = spelt_out(plan.env, plan.options, plugins)
    compared = {name: (getattr(result, name), getattr(plan, name)) for name in _NUMBERS}
    compared["mujoco"] = (result.versions.get("mujoco"), metadata.version("mujoco"))
    compared |= {f"game.{name}": (value, here.get(name)) for name, value in result.options_played.items()}
    compared["adversary's sha256"] = (result.adversary.sha256, hashes[0])
    compared["victim's sha256"] = (result.victim.sha256, hashes[1])
    for name, (then, now) in compared.items():
        if then != now:
            raise ConfigError(
                f"{path} holds {plan.title} with {name} {then}, this call has {now}: "
                "take another --out file, or the same settings"
            )


class Figure(BaseModel):
    """One share beside its published value.

    Attributes:
        measured: share of games, with its Wilson interval.
        published: per cent, or ``None``.
        difference: measured minus published, with Newcombe's interval; ``None`` without a published one.
    """

    measured: Rate
    published: float | None = None
    difference: Difference | None = None

    @computed_field  # type: ignore[prop-decorator]
    @property
    def verdict(self) -> str:
        """``agrees: +1.2 [-2.8, 5.2]`` or ``differs by +5.2 [1.3, 9.1]``, in points; empty if unpublished."""
        if self.difference is None:
            return ""
        what = "agrees:" if self.difference.within_noise else "differs by"
        value, low, high = (
            100 * x for x in (self.difference.value, self.difference.low, self.difference.high)
        )
        return f"{what} {value:+.1f} [{low:.1f}, {high:.1f}]"


class FidelityRow(BaseModel):
    """A row that was played: its plan, the score, and both figures beside the published ones."""

    plan: RowPlan
    result: EvaluationResult

    @computed_field  # type: ignore[prop-decorator]
    @property
    def win(self) -> Figure:
        """The adversary's wins."""
        score = self.plan.published
        return self._figure(self.result.wins, self.result.win_rate, None if score is None else score.win)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def win_or_tie(self) -> Figure:
        """The adversary's wins and ties."""
        score, count = self.plan.published, self.result.wins + self.result.ties
        return self._figure(count, self.result.win_or_tie_rate, None if score is None else score.win_or_tie)

    def _figure(self, count: int, measured: Rate, percent: float | None) -> Figure:
        score = self.plan.published
        if score is None or percent is None:
            return Figure(measured=measured)
        base = round(percent * score.games / 100)
        compared = difference(count, self.result.episodes, base, score.games)
        return Figure(measured=measured, published=percent, difference=compared)
