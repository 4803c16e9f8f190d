"""Learning curves: what is in them, checked by hand, and what cannot be drawn."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from apil_core import ApilError, ConfigError, RunDirError
from apil_core.common import colours
from apil_core.studies.curves.curves import read_curve
from apil_core.studies.curves.groups import read_groups
from apil_core.studies.curves.picture import draw_curves
from studies.paper_runs import VICTIM, row, score, write_run

THREE = [row(1000, 10, 5), row(2000, 40, 10, 6), row(3000, 100, 50, 10)]


# --- one run


def test_shares_of_games_with_wilsons_interval_by_hand(tmp_path: Path) -> None:
    """10 of 40: centre (.25 + 3.8415/80) / 1.09604 = .2719, half width 1.96 · .07272 / 1.09604 = .1300."""
    curve = read_curve(write_run(tmp_path / "r", THREE))
    win, either = curve.lines["win"], curve.lines["win_or_tie"]
    assert win.steps == either.steps == [2000, 3000]  # 10 games are too few
    assert win.value == pytest.approx([0.25, 0.5])
    assert either.value == pytest.approx([0.4, 0.6])
    assert (win.low[0], win.high[0]) == pytest.approx((0.1419, 0.4020), abs=2e-4)
    assert (curve.method, curve.env, curve.victim, curve.seed, curve.steps) == (
        *("adrl", "toy-pursuit", VICTIM),
        *(0, 3000),
    )


def test_returns_are_weighted_by_the_games_that_ended(tmp_path: Path) -> None:
    """(30 · 1 + 10 · 5) / 40 = 2; and 1000 games push out what was before."""
    means = {1000: (30, 1.0), 2000: (10, 5.0), 3000: (0, None), 4000: (1000, 7.0), 5000: (200, 1.0)}
    rows = []
    for steps, (games, mean) in means.items():
        more = {} if mean is None else {"return/adversary": mean}
        rows.append({**row(steps, 100, 0), "games": games, **more})
    line = read_curve(write_run(tmp_path / "r", rows)).lines["return"]
    assert line.steps == [1000, 2000, 4000, 5000]
    assert line.value == pytest.approx([1.0, 2.0, 7.0, (7000 + 200) / 1200])


def test_the_imitator_beside_the_best_constant(tmp_path: Path) -> None:
    rows = [
        row(1000, 30, 0),  # before its first update
        row(2000, 30, 0, **{"apil/mse": 3.0, "apil/constant_mse": 2.0}),
        row(3000, 30, 0, **{"apil/mse": 1.0, "apil/constant_mse": 0.0}),
    ]
    lines = read_curve(write_run(tmp_path / "r", rows)).lines
    assert (lines["imitator"].steps, lines["imitator"].value) == ([2000], [1.5])
    assert "imitator" not in read_curve(write_run(tmp_path / "s", THREE)).lines


def test_single_metrics_without_their_gaps(tmp_path: Path) -> None:
    rows = [row(1000, 30, 0, **{"ppo/kl": 0.5}), row(2000, 30, 0, **{"ppo/kl": float("nan")})]
    line = read_curve(write_run(tmp_path / "r", rows), ["ppo/kl"]).lines["ppo/kl"]
    assert (line.steps, line.value) == ([1000], [0.5])
    with pytest.raises(ConfigError, match="there is no number yet for metric 'never'"):
        read_curve(write_run(tmp_path / "n", [row(1000, 30, 0, never=float("nan"))]), ["never"])


def test_scores_periodic_final_and_of_earlier_ends(tmp_path: Path) -> None:
    periodic = {
        f"evaluation/{name}{end}": value
        for name, value in (("win", 0.3), ("win_or_tie", 0.4))
        for end in ("", "_low", "_high")
    }
    rows = [row(1000, 30, 0), row(2000, 30, 9, **periodic, **{"evaluation/episodes": 10}), row(3000, 30, 9)]
    run = write_run(tmp_path / "r", rows)
    run.write_json(run.result_path, score(1000, 25, 0, 75))
    run.write_json(run.path / "result-9000.json", score(9000, 100, 0, 0))  # of a course that was abandoned
    shutil.move(run.result_path, run.path / "result-1000.json")
    run.write_json(run.result_path, score(3000, 50, 20, 30))
    points = read_curve(run).scores
    assert [(p.steps, p.episodes, p.win.value, p.win_or_tie.value) for p in points] == [
        (1000, 100, 0.25, 0.25),
        (2000, 10, 0.3, 0.4),
        (3000, 100, 0.5, 0.7),
    ]


def test_the_victim_is_the_one_that_played(tmp_path: Path) -> None:
    run = write_run(tmp_path / "r", THREE, victim="auto")
    assert read_curve(run).victim == "auto"
    run.write_json(run.result_path, score(3000, 1, 0, 1, victim="zoo:a/b/v1"))
    assert read_curve(run).victim == run.victim() == "zoo:a/b/v1"


# --- several


def test_seeds_become_a_mean_with_their_standard_deviation(tmp_path: Path) -> None:
    """Shares .2 and .6: mean .4, standard deviation .4/√2 = .2828. The second stops at 2500 steps."""
    one = write_run(tmp_path / "a", [row(1000, 50, 10), row(2000, 50, 10), row(3000, 50, 10)], seed=0)
    two = write_run(tmp_path / "b", [row(1500, 50, 20), row(2500, 50, 40)], seed=1)
    other = write_run(tmp_path / "c", THREE, seed=1, ppo={"num_steps": 16, "learning_rate": 1e-3})
    first, second = read_groups([one, two, other])
    assert (first.label, first.seeds) == (f"adrl ({one.path})", [0, 1])
    assert (second.label, second.seeds) == (f"adrl ({other.path})", [1])
    win = first.lines["win"]
    assert win.steps == [2000]
    assert win.value == pytest.approx([0.4])  # between .4 and .8 the second stands at .6
    assert (win.low[0], win.high[0]) == pytest.approx((0.4 - 0.28284, 0.4 + 0.28284), abs=1e-4)


def test_the_same_seed_twice_is_no_second_seed(tmp_path: Path) -> None:
    runs = [write_run(tmp_path / name, THREE) for name in "ab"]
    assert [len(group.curves) for group in read_groups(runs)] == [1, 1]


def test_what_does_not_change_the_attack_does_not_part_seeds(tmp_path: Path) -> None:
    one = write_run(tmp_path / "a", THREE, threads=1, evaluation={"episodes": 5})
    two = write_run(tmp_path / "b", THREE, threads=2, seed=1, evaluation={"episodes": 9})
    assert [group.seeds for group in read_groups([one, two])] == [[0, 1]]


def test_labels_say_what_differs(tmp_path: Path) -> None:
    one = write_run(tmp_path / "a", THREE)
    two = write_run(tmp_path / "b", THREE, method="apl")
    three = write_run(tmp_path / "c", THREE, victim="baseline:zero/7x2")
    assert [group.label for group in read_groups([one, two])] == ["adrl", "apl"]
    assert [group.label for group in read_groups([one, three])] == [VICTIM, "baseline:zero/7x2"]
    assert [group.label for group in read_groups([two, three])] == [
        f"apl, {VICTIM}",
        "adrl, baseline:zero/7x2",
    ]


# --- the picture


def drawn(tmp_path: Path, *runs: object) -> str:
    path = tmp_path / "curve.svg"
    draw_curves(read_groups(runs), path)  # type: ignore[arg-type]
    return path.read_text("utf-8")


def web(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def test_the_picture_names_game_method_victim_and_steps(tmp_path: Path) -> None:
    run = write_run(tmp_path / "r", THREE, seed=7)
    run.write_json(run.result_path, score(3000, 50, 20, 30))
    text = drawn(tmp_path, run)
    assert f"adrl against {VICTIM} in toy-pursuit" in text
    assert "3,000 steps, seed 7." in text
    assert "evaluations of 100 games each, with 95 % intervals" in text
    assert web(colours.ADVERSARY) in text
    assert "imitator" not in text


def test_several_groups_have_a_legend_and_a_colour_each(tmp_path: Path) -> None:
    runs = [write_run(tmp_path / f"s{seed}", THREE, seed=seed) for seed in (0, 1)]
    runs.append(write_run(tmp_path / "apl", THREE, method="apl"))
    text = drawn(tmp_path, *runs)
    assert f"Attacks against {VICTIM} in toy-pursuit" in text
    assert ">adrl, 2 seeds<" in text
    assert ">apl<" in text
    assert "mean (thick line) ± standard deviation over seeds" in text
    assert all(web(colour) in text for colour in colours.LINES[:2])
    assert web(colours.LINES[2]) not in text


def test_a_name_with_dollars_is_no_formula(tmp_path: Path) -> None:
    run = write_run(tmp_path / "r", THREE, victim="onnx:$a$_b")
    assert "onnx:$a$_b" in drawn(tmp_path, run)


@pytest.mark.parametrize(("name", "begin"), [("c.png", b"\x89PNG"), ("c.PDF", b"%PDF"), ("c.svg", b"<?xml")])
def test_formats(tmp_path: Path, name: str, begin: bytes) -> None:
    draw_curves(read_groups([write_run(tmp_path / "r", THREE)]), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(begin)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "r"])


def test_scores_of_none_and_all(tmp_path: Path) -> None:
    """Where rounding puts an interval's end past the share."""
    run = write_run(tmp_path / "r", THREE)
    for wins, losses in ((0, 20), (20, 0), (0, 7), (7, 0)):
        run.write_json(run.result_path, score(3000, wins, 0, losses))
        draw_curves(read_groups([run]), tmp_path / "c.png")


def test_a_picture_that_cannot_be_written(tmp_path: Path) -> None:
    groups = read_groups([write_run(tmp_path / "r", THREE)])
    with pytest.raises(RunDirError, match="cannot write /proc/c.png"):
        draw_curves(groups, Path("/proc/c.png"))


# --- what cannot be drawn


def cut(lines: str) -> str:
    return lines.splitlines()[0] + "\n{nonsense\n" + lines.splitlines()[1] + "\n"


BROKEN = {
    "nothing": (lambda lines: "", "0 training games have ended, a curve needs 20"),
    "short": (lambda lines: lines.splitlines()[0] + "\n", "10 training games have ended, a curve needs 20"),
    "damaged": (cut, "metrics.jsonl:2: damaged line"),
    "text": (lambda lines: lines.replace("2000", '"a lot"'), "metrics.jsonl:2: damaged line"),
    "foreign": (lambda lines: '{"loss": 1}\n', "metrics.jsonl:1: damaged line"),
    "null": (lambda lines: lines.replace("3000", "null"), "metrics.jsonl:3: damaged line"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_metrics_are_named(tmp_path: Path, kind: str) -> None:
    run = write_run(tmp_path / "r", THREE)
    change, message = BROKEN[kind]
    run.metrics_path.write_text(change(run.metrics_path.read_text()))
    with pytest.raises(ApilError) as caught:
        read_groups([run])
    assert message in str(caught.value)
    assert str(run.metrics_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_things_that_cannot_be_drawn(tmp_path: Path) -> None:
    run = write_run(tmp_path / "r", THREE)
    late = write_run(tmp_path / "late", [row(9000, 30, 3)], seed=1)
    with pytest.raises(ApilError, match="no steps in common"):
        read_groups([run, late])
    with pytest.raises(ApilError, match="is named twice"):
        read_groups([run, run])
    with pytest.raises(ApilError, match="has no metric 'window_win' .did you mean 'window_wins'"):
        read_groups([run], ["window_win"])
    run.result_path.write_text('{"status": "finished", "evaluation": {"wins": 3}}')
    with pytest.raises(ApilError, match="result.json is damaged"):
        read_groups([run])
    run.result_path.unlink()
    run.metrics_path.unlink()
    with pytest.raises(ApilError, match="cannot read .*metrics.jsonl"):
        read_groups([run])
    with pytest.raises(ApilError, match="is no run directory"):
        read_groups([type(run)(tmp_path)])
