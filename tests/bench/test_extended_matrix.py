"""A matrix that has changed since its directory was begun: what is done again, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from apil_core.api.config import PPOConfig
from apil_core.cli.bench_run import _same_as_stored
from apil_core.common.errors import ConfigError
from apil_core.common.numbers import whole_number
from apil_core.evaluation.crossplay.crossplay import crossplay
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.folder import BenchDir, read_score
from apil_core.studies.bench.jobs import JobStatus, make_jobs
from apil_core.studies.bench.matrix import Matrix, RetrainingStage, load_matrix
from apil_core.studies.bench.players import with_full_names
from apil_core.studies.bench.schedule import run_jobs
from apil_core.studies.bench.still_valid import check_same_retraining, still_valid
from tests.bench.small_matrix import Here, small_matrix

GAME = "toy-pursuit"


def matrix(**changes: Any) -> Matrix:
    base: dict[str, Any] = {"steps": 512, "scores": {"plain": {"episodes": 4}}, "crossplay": {"episodes": 4}}
    return small_matrix(**{**base, **changes})


def run(root: Path, **changes: Any) -> CrossPlay | None:
    bench = BenchDir(root)
    benchmark = _same_as_stored(bench, resolve_matrix(matrix(**changes)))
    bench.write_matrix(benchmark.matrix)
    course = run_jobs(make_jobs(benchmark), JobStatus(bench, benchmark), Here(root))
    assert set(course.states.values()) == {"done"}
    return CrossPlay.stored(bench.crossplay_path(GAME))


def labels(document: CrossPlay | None) -> list[str]:
    return [player.label for player in document.adversaries]


@pytest.mark.slow
def test_cross_play_keeps_up_with_its_matrix(tmp_path: Path) -> None:
    first = run(tmp_path)
    assert labels(first) == ["adrl"]
    more = run(tmp_path, seeds=[0, 1])  # labels change, and games that were played stay
    assert labels(more) == ["adrl/s0", "adrl/s1"]
    assert more.scores[0] == first.scores[0]
    again = run(tmp_path, seeds=[0, 1], crossplay={"episodes": 6})
    assert {score.episodes for score in again.played} == {6}
    longer = run(tmp_path, steps=1024)  # the same run, and somebody else by now
    assert labels(longer) == ["adrl"]
    assert longer.adversaries[0].name == first.adversaries[0].name
    assert longer.adversaries[0].sha256 != first.adversaries[0].sha256


def test_a_raised_budget_takes_finished_cells_on(tmp_path: Path) -> None:
    whole = {"crossplay": None, "snapshots": {}}
    run(tmp_path / "raised", **whole)
    bench = BenchDir(tmp_path / "raised")
    ((cell,), first) = resolve_matrix(bench.matrix()).cells, bench.cells()[0].run
    before = (first.result() or {})["steps"], bench.snapshot_path(cell.name).read_bytes()
    retrained = bench.retrained_dir(cell.name)
    retrained.mkdir(parents=True)
    run(tmp_path / "raised", steps=1024, **whole)
    run(tmp_path / "at_once", steps=1024, **whole)
    (raised,), (at_once,) = bench.cells(), BenchDir(tmp_path / "at_once").cells()
    assert before[0] == 512
    one, other = (read_score(each.run.path, "plain") for each in (raised, at_once))
    assert (raised.cell.name, raised.cell.steps, one.trained_steps) == (cell.name, 1024, 1024)
    assert one.wins == other.wins
    assert raised.run.last_metrics()["ppo/value"] == at_once.run.last_metrics()["ppo/value"]
    assert not retrained.exists()  # it was hardened against another adversary
    assert (tmp_path / "raised" / "earlier" / cell.name / "0").is_dir()
    assert bench.snapshot_path(cell.name).read_bytes() != before[1]


def test_the_first_of_several_budgets_must_stay(tmp_path: Path) -> None:
    bench = BenchDir(tmp_path)
    bench.write_matrix(resolve_matrix(matrix(steps=[512, 1024])).matrix)
    for steps in ([1024], [1024, 512], 2048):
        with pytest.raises(ConfigError, match=r"has the budgets 512, 1024, .*: put new ones behind it"):
            _same_as_stored(bench, resolve_matrix(matrix(steps=steps)))
    _same_as_stored(bench, resolve_matrix(matrix(steps=[512, 2048])))


def test_a_lower_budget_than_was_begun_is_told(tmp_path: Path) -> None:
    run(tmp_path, crossplay=None)
    with pytest.raises(ConfigError, match="raised to 512 steps, the matrix says 500; go on with --steps 512"):
        _same_as_stored(BenchDir(tmp_path), resolve_matrix(matrix(steps=500)))


def test_a_benchmark_of_an_older_version_keeps_its_cells_names(tmp_path: Path) -> None:
    bench = BenchDir(tmp_path)
    old = resolve_matrix(matrix(version=1, steps=["1M", "8M"]))
    assert [cell.name for cell in old.cells] == [f"{GAME}/adrl/s0-1M", f"{GAME}/adrl/s0-8M"]
    bench.write_matrix(old.matrix)
    now = resolve_matrix(matrix(steps=["1M", "8M"]))
    assert [cell.name for cell in now.cells] == [f"{GAME}/adrl/s0", f"{GAME}/adrl/s0-8M"]
    assert [cell.name for cell in _same_as_stored(bench, now).cells] == [cell.name for cell in old.cells]


def test_victims_are_called_as_runs_call_them() -> None:
    found = with_full_names(resolve_matrix(matrix(victims={GAME: ["random"]})), "matrix")
    assert found.matrix.victims == {GAME: ("baseline:random/7x2",)}
    assert found.cells[0].config.victim == "baseline:random/7x2"
    with pytest.raises(ConfigError, match=r"m, toy-pursuit against embedded:nobody: .*unknown victim"):
        with_full_names(resolve_matrix(matrix(victims={GAME: ["embedded:nobody"]})), "m")


def test_another_victim_is_refused(tmp_path: Path) -> None:
    bench, benchmark = BenchDir(tmp_path), resolve_matrix(matrix())
    bench.write_matrix(benchmark.matrix)
    other = resolve_matrix(matrix(victims={GAME: ["baseline:random/7x2"]}))
    with pytest.raises(ConfigError, match="attacks scripted:.* the matrix says baseline:random/7x2"):
        _same_as_stored(bench, other, [GAME])
    assert _same_as_stored(bench, other).matrix == benchmark.matrix  # a default that has changed is pinned


def test_a_retraining_with_other_settings_is_refused(tmp_path: Path) -> None:
    text = "kind: retraining\nadversaries: [random]\nenv: toy-pursuit\nvictim: zero\nvictim_side: 1\n"
    (tmp_path / "config.yaml").write_text(text)
    check_same_retraining(tmp_path, RetrainingStage(steps=5))
    with pytest.raises(ConfigError, match="begun with adversary_share 0.5, the matrix says 0.8"):
        check_same_retraining(tmp_path, RetrainingStage(adversary_share=0.8))
    with pytest.raises(ConfigError, match=r"begun with ppo\.epochs 4, the matrix says 10"):
        check_same_retraining(tmp_path, RetrainingStage(ppo=PPOConfig(epochs=10)))


def test_paths_start_at_the_matrix(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text("methods: [adrl]\ngames: [toy-pursuit]\nconfig: {plugins: [p.py]}\n")
    assert load_matrix(str(tmp_path / "m.yaml")).config["plugins"] == [str(tmp_path / "p.py")]
    (tmp_path / "v.onnx").touch()
    (tmp_path / "m.yaml").write_text(
        "methods: [adrl]\ngames: [toy-pursuit]\nvictims: {toy-pursuit: [onnx:v.onnx, random]}\n"
        "adversaries: {toy-pursuit: {other: onnx:v.onnx}}\n"
    )
    found = load_matrix(str(tmp_path / "m.yaml"))
    assert found.victims == {GAME: (f"onnx:{tmp_path}/v.onnx", "random")}
    assert found.adversaries == {GAME: {"other": f"onnx:{tmp_path}/v.onnx"}}
    (tmp_path / "m.yaml").write_text("")
    with pytest.raises(ConfigError, match=r"m\.yaml: methods: missing"):
        load_matrix(str(tmp_path / "m.yaml"))


@pytest.mark.parametrize("text", ["inf", "1e999", "nan", "1.5", "1Q", ""])
def test_no_whole_number(text: str) -> None:
    with pytest.raises(ValueError, match="not a whole number"):
        whole_number(text)


def test_of_two_labels_of_one_policy_each_stays(tmp_path: Path) -> None:
    adversaries, victims = {"baseline": "zero", "mine": "zero"}, {"original": "random"}
    played = crossplay(adversaries, victims, env=GAME, episodes=4, out=tmp_path / "c.json")
    names = [{p.label: p.name for p in players} for players in (played.adversaries, played.victims)]
    assert still_valid(played, *names, {}, (4, None)) == played


def test_a_begun_cell_takes_the_matrixs_present_evaluations(tmp_path: Path) -> None:
    config = small_matrix().config
    run(tmp_path, crossplay=None)
    often = {**config, "evaluation": {"episodes": 0, "every_steps": 512, "periodic_episodes": 4}}
    run(tmp_path, crossplay=None, steps=1024, config=often)
    (found,) = BenchDir(tmp_path).cells()
    assert found.run.config().evaluation.every_steps == 512
    assert found.run.last_metrics()["evaluation/episodes"] == 4


@pytest.mark.parametrize(
    ("stage", "reason"),
    [
        ({"steps": "1k"}, "leave embedded:kick-and-defend/kicker/v1 as it is"),
        ({"freeze": "value"}, "--freeze value needs the victim's own value network"),
        ({"num_envs": 2}, r"num_envs \(2\) must be at least ppo.minibatches \(4\)"),
        ({"ppo": {"critic_observes": "both"}}, "ppo.critic_observes is no setting of a retraining"),
    ],
    ids=str,
)
def test_a_retraining_that_cannot_be_is_refused_before_the_trainings(stage, reason) -> None:
    kick = "kick-and-defend"
    asked = small_matrix(games=[kick], victims={kick: [f"embedded:{kick}/kicker/v1"]}, retraining=stage)
    with pytest.raises(ConfigError, match=rf"^m, kick-and-defend against embedded:.*{reason}"):
        with_full_names(resolve_matrix(asked), "m")
