"""Ships students and writes their table in ``docs/victims.md``.

    python docs/make_students.py ship DIR...   # finished directories of `apil distill`
    python docs/make_students.py               # the table only

``ship`` puts DIR/student.safetensors into the package under its teacher's name, plays 1000 games in its
teacher's place against the zoo opponent, keeps them in ``docs/results/students.jsonl`` and notes the score
in the file. The teacher's own games are those of ``docs/results/fidelity.jsonl``: same code, same seed,
same settings. Needs the zoo's weights.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from apil_core import EvaluationResult, evaluate
from apil_core.common.statistics import Difference, difference
from apil_core.config.game import spelt_out
from apil_core.evaluation.fidelity.rows import FidelityRow, read_rows
from apil_core.evaluation.results import wilson
from apil_core.plugins.registry import default_plugins
from apil_core.policies.student import load_file, save_policy
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.distillation.report import Report
from apil_core.training.export.embedded import folder

HERE = Path(__file__).parent
PAGE = HERE / "victims.md"
ROWS = HERE / "results" / "students.jsonl"
TEACHERS = HERE / "results" / "fidelity.jsonl"
BEGIN, END = "<!-- made by make_students.py -->", "<!-- end of what make_students.py made -->"


@dataclass
class Row:
    """A shipped student: what ``apil distill`` measured, and its 1000 games."""

    report: Report
    network: str
    result: EvaluationResult

    @property
    def name(self) -> str:
        return self.report.teacher.replace("zoo:", "embedded:", 1)

    def dump(self) -> str:
        parts = {
            "report": self.report.model_dump(mode="json"),
            "network": self.network,
            "result": self.result.model_dump(mode="json"),
        }
        return json.dumps(parts)

    @classmethod
    def load(cls, line: str) -> Row:
        parts = json.loads(line)
        report, result = (
            kind.model_validate(parts[key])
            for kind, key in ((Report, "report"), (EvaluationResult, "result"))
        )
        return cls(report, parts["network"], result)


def counts(result: EvaluationResult, role: str) -> tuple[int, int, int, int]:
    """Wins, ties, losses and games as the side named ``role`` had them."""
    wins, losses = result.wins, result.losses
    if role == result.victim_side:
        wins, losses = losses, wins
    return wins, result.ties, losses, result.episodes


def play(report: Report, episodes: int) -> EvaluationResult:
    """The game's own pairing, with the student in its teacher's place."""
    student = report.teacher.replace("zoo:", "embedded:", 1)
    spec = default_plugins().game(report.env)
    attacked = report.role == spec.sides[spec.victim_side]
    adversary, victim = (report.opponent, student) if attacked else (student, report.opponent)
    return evaluate(adversary, env=report.env, victim=victim, episodes=episodes, seed=0)


def teacher_row(row: Row) -> FidelityRow:
    """The same pairing with the teacher, from the fidelity report."""
    names = {row.report.teacher, row.report.opponent}
    for other in read_rows(TEACHERS):
        plan, a, b = other.plan, row.result, other.result
        same = (a.seed, a.num_envs, a.versions, a.episodes) == (b.seed, b.num_envs, b.versions, b.episodes)
        modes = (a.adversary_actions, a.victim_actions) == (b.adversary_actions, b.victim_actions)
        pair = {plan.adversary, plan.victim} == names
        # default options are spelt out in one file and left out in the other
        default = spelt_out(plan.env, {}, default_plugins())
        options = {**default, **a.options_played} == {**default, **b.options_played}
        if plan.env == row.report.env and plan.kind == "default" and pair and same and modes and options:
            return other
    raise SystemExit(f"{TEACHERS} has no row of {sorted(names)} with the settings of {row.name}'s games")


def ship(directory: Path, episodes: int = 1000) -> Row:
    report = Report.model_validate_json((directory / "report.json").read_bytes())
    config = DistillConfig.model_validate_json((directory / "distillation.json").read_bytes())
    student = load_file(directory / "student.safetensors", "student")
    target = folder() / f"{report.teacher.removeprefix('zoo:')}.safetensors"
    target.parent.mkdir(parents=True, exist_ok=True)
    save_policy(target, student.shape, student.weights, student.info.provenance)
    row = Row(report, config.network, play(report, episodes))
    provenance = dict(student.info.provenance)
    for who, result in (("student", row.result), ("teacher", teacher_row(row).result)):
        wins, ties, losses, games = counts(result, report.role)
        provenance[f"{who}_score"] = (
            f"win {wins}, tie {ties}, loss {losses} of {games} games against {report.opponent}, sampled"
        )
    save_policy(target, student.shape, student.weights, provenance)
    print(f"{row.name}: {provenance['student_score']}; teacher: {provenance['teacher_score']}")
    return row


def points(gap: Difference) -> str:
    return f"{100 * gap.value:+.1f} [{100 * gap.low:+.1f}, {100 * gap.high:+.1f}]"


def rate(count: int, games: int) -> str:
    share = wilson(count, games)
    return f"{100 * share.value:.1f} [{100 * share.low:.1f}, {100 * share.high:.1f}]"


def table(rows: list[Row]) -> list[str]:
    lines = [
        "| student | against | who | win % | tie % | win+tie % | win, difference | win+tie, difference |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        role = row.report.role
        wins, ties, _, games = counts(row.result, role)
        twins, tties, _, tgames = counts(teacher_row(row).result, role)
        gaps = difference(wins, games, twins, tgames), difference(wins + ties, games, twins + tties, tgames)
        own = [rate(wins, games), f"{100 * ties / games:.1f}", rate(wins + ties, games), *map(points, gaps)]
        theirs = [rate(twins, tgames), f"{100 * tties / tgames:.1f}", rate(twins + tties, tgames), "", ""]
        lines.append(f"| `{row.name}` | `{row.report.opponent}` | student | {' | '.join(own)} |")
        lines.append(f"| | | teacher | {' | '.join(theirs)} |")
    lines += [
        "",
        "| student | network | steps | error, σ | error, perturbed, σ | best constant, σ | size |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        report, file = row.report, folder() / f"{row.name.removeprefix('embedded:')}.safetensors"
        errors = (
            report.action_error.rms_sigma,
            report.perturbed_action_error.rms_sigma,
            report.action_error.constant_rms_sigma,
        )
        cells = [f"`{row.name}`", row.network, f"{report.steps:,}", *(f"{error:.2f}" for error in errors)]
        lines.append(f"| {' | '.join(cells)} | {file.stat().st_size / 1000:.0f} kB |")
    return lines


def read() -> dict[str, Row]:
    if not ROWS.is_file():
        return {}
    rows = [Row.load(line) for line in ROWS.read_text().splitlines()]
    return {row.name: row for row in rows}


def main(arguments: list[str]) -> None:
    rows = read()
    if arguments[:1] == ["ship"]:
        for directory in arguments[1:]:
            row = ship(Path(directory))
            rows[row.name] = row
            ROWS.write_text("".join(f"{each.dump()}\n" for _, each in sorted(rows.items())))
    elif arguments:
        raise SystemExit(__doc__)
    before, _, rest = PAGE.read_text().partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise SystemExit(f"{PAGE} has no line {BEGIN!r} … {END!r}")
    made = "\n".join([BEGIN, "", *table([rows[name] for name in sorted(rows)]), "", END])
    PAGE.write_text(f"{before}{made}{after}")


if __name__ == "__main__":
    main(sys.argv[1:])
