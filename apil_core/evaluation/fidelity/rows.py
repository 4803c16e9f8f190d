"""Finished rows of ``apil fidelity`` on disk, as they take hours to compute."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path

from pydantic import BaseModel, ValidationError, computed_field

from apil_core.common.errors import ConfigError
from apil_core.common.files import check_place, locked_for, write_atomically
from apil_core.common.statistics import Difference, difference
from apil_core.config.game import spelt_out
from apil_core.evaluation.fidelity.plan import RowPlan
from apil_core.evaluation.results import EvaluationResult, Rate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import load_policy

_NUMBERS = ("episodes", "seed", "num_envs")


class FidelityFile:
    """One JSON object per line; rewritten atomically with every row.

    Args:
        path: created with the first row if it is not there.

    Raises:
        ConfigError: the file is not writable, or a line is no row.
    """

    def __init__(self, path: Path):
        self.path = path
        check_place(path)
        self.rows = _read(path)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Lock the file against other processes, and read it again.

        Raises:
            ConfigError: another process holds the lock.
        """
        with locked_for(self.path, "apil fidelity"):
            self.rows = _read(self.path)
            yield

    def played(
        self, plans: Iterable[RowPlan], plugins: PluginRegistry
    ) -> dict[tuple[object, ...], FidelityRow]:
        """Rows of ``plans`` that are in the file, by identity.

        Raises:
            ConfigError: one of them was played with other settings than requested now.
        """
        here = {row.plan.identity: row for row in self.rows}
        found = {}
        for plan in plans:
            row = here.get(plan.identity)
            if row is not None:
                self._check_same(plan, row, plugins)
                # the published score may have been corrected since; the games are unchanged
                found[plan.identity] = row.model_copy(update={"plan": plan})
        return found

    def add(self, row: FidelityRow) -> None:
        """Add a row and write the file.

        Raises:
            RunDirError: the file cannot be written; its contents are unchanged.
        """
        self.rows.append(row)
        computed = {"win", "win_or_tie"}
        text = "".join(f"{kept.model_dump_json(exclude=computed)}\n" for kept in self.rows)
        write_atomically(self.path, lambda file: file.write(text.encode()))

    def _check_same(self, plan: RowPlan, row: FidelityRow, plugins: PluginRegistry) -> None:
        """Compare everything that a row's numbers depend on."""
        result, policies = row.result, (plan.adversary, plan.victim)
        hashes = [load_policy(name, plugins=plugins).info.sha256 for name in policies]
        here = spelt_out(plan.env, plan.options, plugins)
        compared = {name: (getattr(result, name), getattr(plan, name)) for name in _NUMBERS}
        compared["mujoco"] = (result.versions.get("mujoco"), metadata.version("mujoco"))
        compared |= {f"game.{name}": (value, here[name]) for name, value in result.options_played.items()}
        compared["adversary's sha256"] = (result.adversary.sha256, hashes[0])
        compared["victim's sha256"] = (result.victim.sha256, hashes[1])
        for name, (then, now) in compared.items():
            if then != now:
                raise ConfigError(
                    f"{self.path} holds {plan.title} with {name} {then}, this call has {now}: "
                    "take another --out file, or the same settings"
                )


def read_rows(path: Path) -> list[FidelityRow]:
    """The rows of a file that ``apil fidelity --out`` wrote.

    Raises:
        ConfigError: it is not there, or a line is no row.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no such file")
    return _read(path)


def _read(path: Path) -> list[FidelityRow]:
    rows = []
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(FidelityRow.model_validate_json(line))
        except ValidationError as error:
            raise ConfigError(f"{path}:{number}: this line is no row of apil fidelity") from error
    return rows


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
