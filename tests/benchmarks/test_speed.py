"""What the speed benchmark measures: plans, rounds, reports. How fast anything is, is not tested."""

from __future__ import annotations

import dataclasses
import json
import mmap
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.small_runs import small_config
from PIL import Image

from apil_core.common.errors import ApilError, ConfigError
from apil_core.plugins.registry import default_plugins
from speed.blocks import Blocks, Lap
from speed.machine import PeakMemory
from speed.measure import measure
from speed.picture import draw_speed
from speed.plan import SpeedRequest, make_plan
from speed.replay import Replay
from speed.report import LEVELS, Setting, SpeedReport, Spread, of_setting
from speed.training import TimedTraining

TOY = SpeedRequest(env=("toy-pursuit",), num_envs=(4, 8), batch=64, seconds=0.01)
SETTING = Setting(env="e", physics="fast", victim="v", num_envs=4, threads=2, num_steps=5)


def measured(request: SpeedRequest, say: Callable[[str], None] = print) -> SpeedReport:
    plugins = default_plugins()
    return measure(
        make_plan(request, plugins),
        plugins,
        command=["speed"],
        say=say,
        keep=lambda report: None,
    )


@pytest.fixture(scope="module")
def toy() -> SpeedReport:
    return measured(TOY)


# --- what is measured


def test_every_level_of_every_setting_has_its_row(toy: SpeedReport) -> None:
    assert [(cell.num_envs, cell.num_steps) for cell in toy.cells] == [(4, 16), (8, 8)]
    for cell in toy.cells:
        assert cell.same_games
        assert cell.rounds == 3
        assert 0 < cell.resident_before_mb <= cell.peak_mb
        rows = of_setting(toy.rows, cell)
        assert [(row.level, row.method) for row in rows] == [
            ("game", None),
            ("victim", None),
            *[(level, method) for level in LEVELS[3:] for method in ("adrl", "e_apil")],
        ]
        for row in rows:
            assert row.ratio_to == "game"  # the toy has no physics that could be timed alone
            assert len(row.seconds) == 3
            assert min(row.seconds) > 0
            assert 0 < row.memory_mb <= cell.peak_mb
        assert rows[0].ratio == Spread(median=1, low=1, high=1)
        # extend_observation once a step by APIL, and the like
        costs = {cost.method: cost for cost in of_setting(toy.hooks, cell)}
        assert costs["e_apil"].calls > costs["adrl"].calls >= cell.num_steps
        assert 0 < costs["e_apil"].dispatch.median < 1


def test_a_mujoco_game_is_compared_with_its_physics() -> None:
    request = SpeedRequest(
        env=("sumo-ants",),
        methods=("adrl",),
        num_envs=(2,),
        threads=(1,),
        levels=("game", "training"),
        physics=("fast", "faithful"),
        batch=32,
        seconds=0.01,
    )
    report = measured(request)
    assert [cell.physics for cell in report.cells] == ["fast", "faithful"]
    for cell in report.cells:
        assert cell.same_games
        rows = of_setting(report.rows, cell)
        assert [row.level for row in rows] == ["physics", "game", "training"]
        assert {row.ratio_to for row in rows} == {"physics"}


def test_games_are_played_again_to_where_they_were_and_the_check_would_see_it() -> None:
    plugins = default_plugins()
    training = TimedTraining(small_config("adrl"), plugins)
    replay = Replay(training.attack, plugins)
    training.iterate()
    start = training.start()
    training.iterate()
    rollout = training.timed_hooks.tape.rollout
    assert not replay.arrived
    assert replay.play(start, rollout) > 0
    assert replay.arrived
    replay.game.reset()
    assert not replay.arrived
    assert replay.play_victim(start, rollout) > 0
    assert replay.arrived
    training.iterate()
    assert not replay.arrived


# --- numbers


def test_spreads_are_medians_and_quartiles() -> None:
    assert Spread.of([3, 1, 2, 4, 5]) == Spread(median=3, low=2, high=4)


def test_ratios_are_taken_block_by_block() -> None:
    blocks = Blocks(SETTING, ("physics", "training"), "physics")
    blocks.add("m", {"physics": (1.0, 10.0), "training": (2.0, 30.0)}, 1.0, Lap(2.0, 0.1, 7))
    blocks.add("m", {"physics": (3.0, 12.0), "training": (4.0, 20.0)}, 3.0, Lap(4.0, 0.1, 9))
    physics, training = blocks.rows()
    assert training.method == "m"
    assert training.ratio.median == pytest.approx((0.5 + 0.75) / 2)
    assert training.steps_per_second.median == pytest.approx((20 / 2 + 20 / 4) / 2)
    assert (physics.ratio.median, training.memory_mb) == (1.0, 30.0)
    (cost,) = blocks.hooks()
    assert cost.calls == 8
    assert cost.dispatch.median == pytest.approx((0.05 + 0.025) / 2)


def test_the_peak_of_memory_begins_anew() -> None:
    memory = PeakMemory()
    # the system's own: malloc may keep what is freed
    with mmap.mmap(-1, 200_000_000) as block:
        block[::4096] = b"x" * len(block[::4096])
        with_it = memory.take()
    if memory.exact:
        memory.take()
        assert memory.take() < with_it - 150
    assert memory.largest >= with_it


# --- report and picture


def test_a_report_survives_its_file(toy: SpeedReport, tmp_path: Path) -> None:
    toy.write(tmp_path / "speed.json")
    assert SpeedReport.model_validate_json((tmp_path / "speed.json").read_bytes()) == toy
    row = json.loads((tmp_path / "speed.json").read_text())["rows"][0]
    assert {"env", "physics", "victim", "level", "method", "num_envs", "threads", "memory_mb"} <= row.keys()


@pytest.mark.parametrize("sizes", [(4,), (4, 8)])
def test_pictures_of_one_and_of_several_numbers_of_games(
    toy: SpeedReport, tmp_path: Path, sizes: tuple[int, ...]
) -> None:
    report = toy.model_copy(update={"rows": [row for row in toy.rows if row.num_envs in sizes]})
    draw_speed(report, tmp_path / "speed.png")
    with Image.open(tmp_path / "speed.png") as picture:
        assert picture.width > 1500


# --- plans


def test_cells_are_all_combinations() -> None:
    request = SpeedRequest(env=("sumo-ants", "toy-pursuit"), num_envs=(16, 32, 16), threads=(1, 2))
    cells = make_plan(request, default_plugins())
    assert [str(cell) for cell in cells[:2]] == [
        "sumo-ants (faithful), 16 games, 1 thread",
        "sumo-ants (faithful), 16 games, 2 threads",
    ]
    assert len(cells) == 8
    configs = [cell.any_config for cell in cells]
    assert {config.num_envs * config.ppo.num_steps for config in configs} == {128 * 128}
    assert list(cells[0].configs) == ["adrl", "e_apil"]


def test_a_preset_gives_games_batch_and_what_is_learnt() -> None:
    (cell,) = make_plan(SpeedRequest(preset=("efficient",)), default_plugins())
    for config in cell.configs.values():
        assert (config.num_envs, config.ppo.num_steps, config.ppo.minibatches) == (32, 128, 8)
    assert cell.configs["e_apil"].options["apil"]["discriminator"]["minibatches"] == 8
    (wide,) = make_plan(SpeedRequest(preset=("efficient",), num_envs=(128,)), default_plugins())
    assert (wide.any_config.ppo.num_steps, wide.any_config.ppo.action_unit) == (32, "limit")


def test_all_games_are_those_that_have_a_victim() -> None:
    both = make_plan(SpeedRequest(env=("all",), physics=("faithful", "fast")), default_plugins())
    profiles = [cell.any_config.game.get("physics") for cell in both if cell.any_config.env == "sumo-ants"]
    assert profiles == ["faithful", "fast"]
    names = [cell.any_config.env for cell in both]
    assert "kick-and-defend" in names
    assert not any(name.startswith("pettingzoo") for name in names)
    assert names.count("toy-pursuit") == 1  # it has no profiles


MISTAKES = {
    "unknown game 'sumo-ant' (did you mean 'sumo-ants'?": {"env": ["sumo-ant"]},
    "unknown method 'adrll' (did you mean 'adrl'?": {"methods": ["adrll"]},
    "unknown level 'phisics' (did you mean 'physics'?": {"levels": ["phisics"]},
    "game 'toy-pursuit' has no physics profiles; leave out --physics": {"physics": ["fast"]},
    "--num-envs: 0 is less than 1": {"num_envs": [0]},
    "--threads: -1 is less than 0": {"threads": [-1]},
    "--batch 64 is no multiple of 48 games": {"num_envs": [48]},
    "--batch 32 is no multiple of 64 games": {"num_envs": [64], "batch": 32},
    "must hold at least two samples": {"num_envs": [4], "batch": 4},
    "--seconds: -1 is not above 0": {"seconds": -1.0},
}


@pytest.mark.parametrize("message", MISTAKES)
def test_mistakes_are_found_before_anything_runs(message: str) -> None:
    changes = {"env": ["toy-pursuit"], "num_envs": [4], "batch": 64} | MISTAKES[message]
    with pytest.raises(ApilError) as error:
        make_plan(SpeedRequest(**changes), default_plugins())  # type: ignore[arg-type]
    assert message in str(error.value)


def test_profiles_nobody_knows() -> None:
    with pytest.raises(ConfigError, match="game sumo-ants: physics: .*'faithful' or 'fast'"):
        make_plan(SpeedRequest(env=("sumo-ants",), physics=("quick",)), default_plugins())


# --- going on


def test_ctrl_c_keeps_finished_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []

    def say(line: str) -> None:
        lines.append(line)
        if line.startswith("2 of 2"):
            monkeypatch.setattr(TimedTraining, "iterate", interrupt)

    def interrupt(training: TimedTraining) -> tuple[float, float]:
        raise KeyboardInterrupt

    report = measured(dataclasses.replace(TOY, methods=("adrl",)), say)
    assert report.interrupted
    assert [cell.num_envs for cell in report.cells] == [4]
    assert {row.num_envs for row in report.rows} == {4}
    assert [line.split(":")[0] for line in lines] == ["1 of 2", "1 of 2", "2 of 2"]
