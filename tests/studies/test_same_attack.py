"""What counts as the same attack with another seed."""

from __future__ import annotations

from pathlib import Path

from apil_core.studies.comparison import compare
from apil_core.studies.curves.groups import seed_groups
from studies.paper_runs import row, score, write_run

ROWS = [row(1000, 100, 50)]


def test_runs_that_differ_in_more_than_the_seed_are_other_attacks(tmp_path: Path) -> None:
    settings = (
        {"seed": 0},
        {"seed": 1, "threads": 2, "evaluation": {"episodes": 7}},
        {"seed": 1},  # a copy
        {"seed": 2, "game": {"max_steps": 25}},
        {"seed": 3, "ppo": {"num_steps": 16, "learning_rate": 1e-3}},
    )
    runs = [write_run(tmp_path / str(i), ROWS, **changes) for i, changes in enumerate(settings)]
    assert seed_groups(runs) == [[0, 1], [2], [3], [4]]


def test_runs_of_more_processes_are_another_attack(tmp_path: Path) -> None:
    """Two processes collect twice the batch; a note that cannot be read stands for one."""
    runs = [write_run(tmp_path / str(seed), ROWS, seed=seed) for seed in range(4)]
    for run in runs[2:]:
        run.write_json(run.environment_path, [{"processes": 1}, {"processes": 2}])
    runs[1].environment_path.write_text("{")
    assert seed_groups(runs) == [[0, 1], [2, 3]]


def test_the_mean_over_seeds_leaves_other_attacks_out(tmp_path: Path) -> None:
    """Wins of 20 % and 40 %: mean 30, standard deviation 20/√2 = 14.14. The 90 % had other options."""
    wins, options = (20, 40, 90), ({}, {}, {"ppo": {"num_steps": 16, "learning_rate": 1e-3}})
    runs = [write_run(tmp_path / str(i), ROWS, seed=i, **changes) for i, changes in enumerate(options)]
    for run, count in zip(runs, wins, strict=True):
        run.write_json(run.result_path, score(1000, count, 0, 100 - count))
    (spread,) = compare(runs).spreads
    assert spread.seeds == [0, 1]
    assert (round(spread.win_mean, 6), round(spread.win_sd, 4)) == (0.3, 0.1414)
