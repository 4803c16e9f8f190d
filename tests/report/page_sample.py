"""A whole report's data, made up: every section has data, and names try to break the page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache
from io import BytesIO

import numpy as np
from PIL import Image

from apil_core.evaluation.crossplay.document import CrossPlay, Player
from apil_core.evaluation.results import wilson
from apil_core.studies.activations.models import ActivationMap, LogLikelihood
from apil_core.studies.curves.curves import Curve, Line, ScorePoint
from apil_core.studies.curves.groups import CurveGroup
from apil_core.studies.report import models as m
from apil_core.studies.report import table_models as t
from apil_core.studies.report.cells import method_difference
from apil_core.studies.report.statistics import compared, published_rate, share, verdict
from report.sample import result

WITHOUT_FIGURES = {
    name: [] for name in ("curves", "aggregates", "profiles", "improvements", "retraining", "activations")
}

NASTY = "<b>my</b> & \"co\" </script><script>document.title='owned'</script>"
"""A plugin's name as it must never be read: as markup."""

GAMES = ("kick-and-defend", "you-shall-not-pass", "sumo-humans", "sumo-ants")
COLUMNS = ["baseline", "adrl", "apl", "apil", "e_apil"]
EPISODES = 1000
PUBLISHED = {
    1: [(28, 29), (48, 49), (80, 80), (85, 86), (89, 90)],
    2: [(28, 29), (48, 49), (80, 80), (85, 86), (89, 90)],
}
MARKS = ["1 M of 35 M = 2.9 %", "1 seed"]


@cache
def report_data(*, nasty: bool = True, games: Sequence[str] = GAMES[:2]) -> m.ReportData:
    """All sections filled; ``nasty`` adds a method whose name is markup. Games: at least the first two."""
    rng = np.random.default_rng(0)
    columns = [*COLUMNS, NASTY] if nasty else COLUMNS
    methods, few = columns[1:], games[: len(games) // 2]
    tables = [_table(number, games, columns, rng) for number in (1, 2, 3, 4)]
    return m.ReportData(
        title="Quick matrix: four games, four methods" + (f" {NASTY}" if nasty else ""),
        games=list(games),
        columns=columns,
        settings=_settings(),
        tables=[*tables, _table(1, games[:1], columns, rng, setting="s2")],
        differences=[d for table in tables for row in table.rows for d in _differences(table, row)],
        aggregates=[_aggregate(column, metric) for column in columns for metric in ("win", "win_or_tie")],
        profiles=[_profile(column, metric) for column in methods for metric in ("win", "win_or_tie")],
        improvements=[
            t.Improvement(
                **{"setting": "s1", "column": column, "base": "adrl", "metric": metric},
                **{"runs": 6, "base_runs": 6, "value": 0.6, "low": 0.4, "high": 0.8},
            )
            for column in methods[1:]
            for metric in ("win", "win_or_tie")
        ],
        curves=[_panel(game, methods, rng) for game in games],
        retraining=[_retraining(game, method, rng) for game in few for method in ("apil", "e_apil")],
        ablations=[_ablation(rng)],
        crossplay=[_crossplay(game, rng) for game in few],
        activations=[_activations(game, rng) for game in few],
        snapshots=[
            m.Snapshot(game=g, method="apil", path="x.png", data_uri=_picture(), caption="A won game.")
            for g in few
        ],
        diagnostics=[_diagnostics(game, method, rng) for game in few for method in methods],
        claims=_claims(),
        warnings=_warnings(nasty),
        unfinished=[
            m.Unfinished(
                game="sumo-ants",
                method="apl",
                label="s1",
                status="failed",
                steps=300_000,
                planned_steps=1_000_000,
                reason=f"plugin broke: {NASTY if nasty else 'ValueError'}",
                path="/tmp/x",
            ),
        ],
        provenance=_provenance(methods),
    )


def _settings() -> list[t.Setting]:
    common = {
        "published_steps": 35_000_000,
        "steps": 1_000_000,
        "budget_share": 1 / 35,
        "victim_actions": "sample",
    }
    return [
        t.Setting(
            id="s1",
            label="1 M steps, fast physics",
            trained_physics="fast",
            physics="fast",
            notes=[
                "Trained for 1 M of 35 M steps (2.9 %).",
                "One seed: nothing can be said about spread.",
                "Trained and scored in fast physics, which is not the paper's.",
            ],
            **common,
        ),
        t.Setting(
            id="s2",
            label="1 M steps, trained fast, scored in faithful physics",
            trained_physics="fast",
            physics="faithful",
            notes=["Trained for 1 M of 35 M steps (2.9 %)."],
            **common,
        ),
    ]


def _cell(
    game: str, column: str, wins: int, ties: int, published: tuple[int, int] | None, seeds: int = 1
) -> t.Cell:
    scores = [
        t.SeedScore(
            seed=i,
            source="cells/x",
            steps=None if column == "baseline" else 1_000_000,
            episodes=EPISODES,
            wins=wins + 7 * i,
            ties=ties,
            losses=EPISODES - wins - 7 * i - ties,
            causes={
                "goal": EPISODES - wins - ties,
                "missed": wins - wins // 3,
                "keeper left": ties,
                "time": wins // 3,
            },
            mean_length=120.5,
        )
        for i in range(seeds)
    ]
    counts = {"win": [s.wins for s in scores], "win_or_tie": [s.wins + s.ties for s in scores]}
    games = [EPISODES] * seeds
    figures = {}
    for k, (name, count) in enumerate(counts.items()):
        measured = share(count, games)
        if published is None:
            figures[name] = t.Figure(measured=measured, verdict="no published value")
        else:
            difference = compared(measured, published_rate(published[k] / 100, EPISODES))
            figures[name] = t.Figure(
                measured=measured,
                published=published[k] / 100,
                difference=difference,
                verdict=verdict(difference),
            )
    return t.Cell(
        game=game, column=column, scores=scores, marks=[] if column == "baseline" else MARKS, **figures
    )


def _table(
    number: int,
    games: Sequence[str],
    columns: list[str],
    rng: np.random.Generator,
    setting: str = "s1",
) -> t.Table:
    rows = []
    for game in games:
        row = []
        for i, column in enumerate(columns):
            published = PUBLISHED[1][i] if i < len(PUBLISHED[1]) else None
            win = int(np.clip(rng.integers(20, 800), 0, 900)) if i else 284
            row.append(_cell(game, column, win, 15, published, seeds=3 if column == "apil" else 1))
        rows.append(row)
    if number == 2:
        rows[1][2] = t.Cell(
            game=GAMES[1],
            column=columns[2],
            win=t.Figure(published=0.65),
            win_or_tie=t.Figure(published=0.65),
        )
        rows[1][3].marks.append("stale")
    titles = {
        1: "Adversaries against the original victims",
        2: "Blinded adversaries",
        3: "Retrained victims against the baseline adversary",
        4: "Retrained victims against the E-APIL adversary",
    }
    return t.Table(
        id=f"t{number}-{setting}",
        number=number,
        name=f"name{number}",
        title=titles[number],
        side="adversary" if number < 3 else "victim",
        setting=setting,
        columns=columns,
        blind="zeros" if number == 2 else None,
        rows=rows,
    )


def _differences(table: t.Table, row: list[t.Cell]) -> list[t.MethodDifference]:
    named = {"table": table.id, "setting": table.setting}
    return [method_difference(cell, row[0], **named) for cell in row[1:] if cell.scores]


def _aggregate(column: str, metric: str) -> t.Aggregate:
    value = 0.1 + 0.1 * (len(column) % 6) + (0.05 if metric == "win_or_tie" else 0)
    return t.Aggregate(
        setting="s1",
        column=column,
        metric=metric,
        iqm=value,
        low=value - 0.06 if column == "apil" else None,  # type: ignore[arg-type]
        high=value + 0.05 if column == "apil" else None,
        games=list(GAMES),
        seeds=1,
        note="One seed: no interval.",
    )


def _profile(column: str, metric: str) -> t.Profile:
    value = [1 - (i / 100) ** (1 + len(column) % 6) for i in range(101)]
    low, high = ([min(max(v + d, 0), 1) for v in value] for d in (-0.1, 0.1))
    named = {"setting": "s1", "column": column, "metric": metric}
    return t.Profile(runs=6, value=value, low=low, high=high, **named)


def _line(rng: np.random.Generator, top: float, n: int = 60, last: int = 1_000_000) -> Line:
    steps = np.linspace(16_384, last, n).astype(int)
    value = np.clip(top * (1 - np.exp(-3 * steps / last)) + rng.normal(0, 0.01, n).cumsum() * 0.4, 0, 1)
    return Line(
        steps=steps.tolist(),
        value=value.tolist(),
        low=np.clip(value - 0.03, 0, 1).tolist(),
        high=np.clip(value + 0.03, 0, 1).tolist(),
    )


def _point(steps: int, wins: int, ties: int) -> ScorePoint:
    return ScorePoint(
        steps=steps, episodes=EPISODES, win=wilson(wins, EPISODES), win_or_tie=wilson(wins + ties, EPISODES)
    )


def _group(label: str, game: str, lines: dict[str, Line], scores: list[ScorePoint]) -> CurveGroup:
    curve = Curve(
        run=f"runs/{label}",
        method=label,
        env=game,
        victim="zoo:kicker-1",
        seed=0,
        steps=1_000_000,
        lines=lines,
        scores=scores,
    )
    return CurveGroup(label=label, curves=[curve], lines=lines)


def _panel(game: str, methods: list[str], rng: np.random.Generator) -> m.CurvePanel:
    groups = []
    for i, method in enumerate(methods):
        win = _line(rng, 0.2 + 0.12 * i)
        tie = Line(
            steps=win.steps,
            value=[min(v + 0.05, 1) for v in win.value],
            low=win.low,
            high=[min(v + 0.05, 1) for v in win.high],
        )
        found = {
            "win": win,
            "win_or_tie": tie,
            "return": Line(steps=win.steps, value=[20 * v - 10 for v in win.value]),
        }
        if "apil" in method:
            found["imitator"] = Line(steps=win.steps, value=[1.2 - 0.5 * v for v in win.value])
        groups.append(_group(method, game, found, [_point(1_000_000, int(1000 * win.value[-1]), 50)]))
    return m.CurvePanel(game=game, setting="s1", groups=groups, baseline_win=0.284, baseline_win_or_tie=0.299)


def _retraining(game: str, method: str, rng: np.random.Generator) -> m.RetrainingCurve:
    groups = [
        _group(o, game, {"win": _line(rng, top), "win_or_tie": _line(rng, top + 0.05)}, [])
        for o, top in (("baseline", 0.7), (method, 0.9))
    ]
    return m.RetrainingCurve(
        game=game,
        method=method,
        label=method,
        steps=1_000_000,
        planned_steps=10_000_000,
        status="stopped",
        groups=groups,
    )


def _ablation(rng: np.random.Generator) -> m.Ablation:
    rows: list[m.AblationRow] = []
    for i, value in enumerate(("imitator", "oracle", "noise", "none")):
        cell = _cell("kick-and-defend", "apil", 300 + 30 * i, 12, None)
        row = m.AblationRow(value=value, cell=cell, imitator_error=0.8 if i == 0 else None)
        row.difference = method_difference(cell, rows[0].cell, setting="s1") if rows else None
        rows.append(row)
    return m.Ablation(
        axis="options.apil.prediction",
        title="what ã is",
        game="kick-and-defend",
        method="apil",
        setting="s1",
        rows=rows,
    )


def _crossplay(game: str, rng: np.random.Generator) -> CrossPlay:
    adversaries, victims = COLUMNS, ["original", "vs adrl", "vs apl", "vs apil", "vs e_apil"]
    return CrossPlay(
        env=game,
        adversaries=[Player(name=label, sha256="", label=label) for label in adversaries],
        victims=[Player(name=label, sha256="", label=label) for label in victims],
        scores=[[result(game, int(wins), 40) for wins in row] for row in rng.integers(50, 900, (5, 5))],
        created="2026-11-22",
    )


def _activations(game: str, rng: np.random.Generator) -> ActivationMap:
    return ActivationMap(
        env=game,
        victim="zoo:kicker-1",
        victim_sha256="",
        layer="LSTM's h",
        units=128,
        opponents=COLUMNS,
        players=[Player(name=label, sha256="", label=label) for label in COLUMNS],
        points=[
            [(float(x), float(y)) for x, y in rng.normal(8 * i, 6, (150, 2))] for i, _ in enumerate(COLUMNS)
        ],
        log_likelihood=[
            LogLikelihood(mean=-90.0 - 14 * i, low=-93.0 - 14 * i, high=-87.0 - 14 * i, n=40, explained=0.9)
            for i, _ in enumerate(COLUMNS)
        ],
        fitted=-80.0,
        games_per_opponent=40,
        samples_per_game=50,
        components=3,
        bic={3: 1.0},
        variance=0.99,
        dimensions=12,
        explained=0.99,
        perplexity=30.0,
        seed=0,
        num_envs=40,
        versions={},
        created="2026-11-22",
    )


def _picture() -> str:
    picture = Image.new("RGB", (1600, 234), (230, 233, 238))
    for i in range(6):
        picture.paste((38 + 30 * i, 88, 204 - 20 * i), (20 + 265 * i, 20, 240 + 265 * i, 214))
    stream = BytesIO()
    picture.save(stream, "PNG")
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()


def _diagnostics(game: str, method: str, rng: np.random.Generator) -> m.Diagnostics:
    steps = np.linspace(16_384, 1_000_000, 60).astype(int).tolist()
    kl = (0.02 * np.exp(rng.normal(0, 0.3, 60))).tolist()
    return m.Diagnostics(
        game=game,
        method=method,
        seed=0,
        setting="s1",
        run="cells/x",
        facts={"kl": kl[-1], "bound": 41.0},
        lines={
            "kl": Line(steps=steps, value=kl),
            "bound": Line(steps=steps, value=[40 + 900 * k**0.5 for k in kl]),
        },
        notes=["The bound is far from tight."],
    )


def _claims() -> list[m.Claim]:
    checks = [
        m.Check(game=game, verdict="cannot be told", text="31.0 % against 28.4 %: within noise.")
        for game in GAMES
    ]
    return [
        m.Claim(
            id="beats baseline",
            claim="Trained adversaries win more often than the baseline adversary.",
            published="In 3 of 4 games.",
            setting="s1",
            verdict="holds",
            text="In 3 of 4 games every method does.",
            checks=checks,
        ),
        m.Claim(
            id="order",
            claim="E-APIL ≥ APIL ≥ APL ≥ ADRL.",
            published="In kick-and-defend only.",
            setting="s1",
            verdict="cannot be told",
            text="One seed cannot order methods.",
            checks=checks,
        ),
        m.Claim(
            id="blinding",
            claim="APIL survives blinding.",
            published="Drops by 4 points at most.",
            setting="s1",
            verdict="does not hold",
            text="It loses 21.0 points in sumo-humans.",
            checks=checks,
        ),
    ]


def _warnings(nasty: bool) -> list[m.Warning]:
    return [
        m.Warning(
            kind="budget",
            loud=True,
            text="Adversaries were trained for 1 M of 35 M steps, 2.9 % of the published budget.",
            setting="s1",
        ),
        m.Warning(
            kind="seeds",
            loud=True,
            text="One seed: no claim about the spread over seeds can be made.",
            setting="s1",
        ),
        m.Warning(
            kind="physics",
            loud=True,
            text="Trained and scored in fast physics; the paper's is the faithful one.",
            setting="s1",
        ),
        m.Warning(
            kind="ties",
            loud=False,
            text="97 % of apl's “win or tie” in sumo-ants are ties.",
            game="sumo-ants",
            column="apl",
        ),
        m.Warning(
            kind="tie meaning",
            loud=False,
            text=f"A tie here means the keeper left its goal. {NASTY if nasty else ''}",
            game=GAMES[0],
        ),
    ]


def _provenance(methods: list[str]) -> m.Provenance:
    runs = [
        m.RunFacts(
            game=game,
            method=method,
            seed=0,
            label="s0",
            path=f"runs/{game}/{method}",
            status="finished",
            steps=1_000_000,
            planned_steps=1_000_000,
            hours=0.31,
            steps_per_second=896.0,
            physics="fast",
            victim="zoo:kicker-1",
            victim_sha256="ab" * 32,
            host="rack-1",
            git="0121387deadbeef",
            versions={"mujoco": "4.0"},
        )
        for game in GAMES
        for method in methods
    ]
    return m.Provenance(
        directories=["runs/quick"],
        matrices={"runs/quick": {"methods": methods, "games": list(GAMES), "steps": [1_000_000]}},
        runs=runs,
        versions={"mujoco": ["4.0.0"], "torch": ["2.13"], "python": ["3.11.2"]},
        git=["0121387"],
        hosts=["rack-1 (2 cores)"],
        hours=5.2,
        steps=16_000_000,
        written="2026-11-22 15:00",
        apil="0.1.0",
    )
