"""A run that was stopped, killed or extended ends with the same bits as one that was not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers.small_runs import differences, final_state, metrics_of, small_config

from apil_core import ApilError, ConfigError, RunDirError, resume, run
from apil_core.common.files import locked
from apil_core.config.resolve import dump_yaml
from apil_core.evaluation.progress import Progress
from apil_core.plugins.registry import default_plugins
from apil_core.runs.dry_run import dry_run
from apil_core.studies.curves.curves import final_scores
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("adrl", {}),
        ("apl", {"apl": {"advantage_difference": True}}),
        pytest.param("apil", {"apil": {"prediction": "noise"}}, marks=pytest.mark.slow),
        pytest.param("e_apil", {}, marks=pytest.mark.slow),  # as in the kill below
        ("e_apil", {"apil": {"rollouts": "own", "imitator": {"update": "ppo"}}}),
    ],
)
def test_extending_equals_running_through(tmp_path, method, options):
    whole = run(small_config(method, options=options), out=tmp_path / "whole")
    run(small_config(method, options=options, steps=whole.steps // 3), out=tmp_path / "parts")
    resumed = resume(tmp_path / "parts", steps=small_config().steps)
    assert resumed.steps == whole.steps
    assert differences(final_state(tmp_path / "whole"), final_state(tmp_path / "parts")) == []


def test_evaluations_during_training_change_nothing(tmp_path):
    run(small_config(), out=tmp_path / "without")
    config = small_config(evaluation={"episodes": 8, "every_steps": 600, "periodic_episodes": 8})
    run(config, out=tmp_path / "with")
    without, with_them = final_state(tmp_path / "without"), final_state(tmp_path / "with")
    assert len(with_them.pop("evaluations")) == 5
    assert without.pop("evaluations") == []
    assert differences(without, with_them) == []
    assert sum("evaluation/win" in line for line in metrics_of(tmp_path / "with")) == 5


def start(run_dir: Path, config) -> subprocess.Popen:
    file = run_dir.parent / "config.yaml"
    file.write_text(dump_yaml(config))
    command = ["run", "--config", str(file), "--out", str(run_dir), "--trust"]
    return subprocess.Popen(
        [sys.executable, "-m", "apil_core.cli", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )


def wait_for_checkpoint(process, run_dir, count=2, seconds=90):
    deadline = time.monotonic() + seconds
    while len(RunDir(run_dir).checkpoints()) < count:
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < deadline, "no checkpoint in time"
        time.sleep(0.01)


KILLS = """
import os, signal
from pathlib import Path
from apil_core import hookimpl

@hookimpl
def iteration_finished(metrics):
    if metrics["iteration"] == 3 and not (once := Path(__file__).with_suffix(".once")).exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_sigkill_and_resume_gives_the_same_bits(tmp_path):
    (tmp_path / "kills.py").write_text(KILLS)
    config = small_config(plugins=(str(tmp_path / "kills.py"),), observers=("kills",))
    process = start(tmp_path / "killed", config)
    assert process.wait() == -signal.SIGKILL, process.communicate()[0]
    assert [m["iteration"] for m in metrics_of(tmp_path / "killed")] == [1, 2, 3]
    assert RunDir(tmp_path / "killed").newest_checkpoint().stem == "iteration-00000002"
    assert RunDir(tmp_path / "killed").result() is None
    resume(tmp_path / "killed")
    run(config, out=tmp_path / "whole")
    assert differences(final_state(tmp_path / "whole"), final_state(tmp_path / "killed")) == []
    assert [m["iteration"] for m in metrics_of(tmp_path / "killed")] == list(range(1, 7))


@pytest.mark.slow  # by default in tests/cli/test_cli_run.py
def test_ctrl_c_checkpoints_and_says_how_to_go_on(tmp_path):
    config = small_config(steps=10_000 * 512)
    process = start(tmp_path / "stopped", config)
    wait_for_checkpoint(process, tmp_path / "stopped", count=1)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 130, output
    assert f"apil resume {tmp_path / 'stopped'}" in output
    assert "Traceback" not in output
    last = metrics_of(tmp_path / "stopped")[-1]
    assert final_state(tmp_path / "stopped")["iteration"] == last["iteration"]
    assert RunDir(tmp_path / "stopped").result()["status"] == "interrupted"


def test_threads_do_not_change_results(tmp_path):
    run(small_config(threads=1), out=tmp_path / "one")
    run(small_config(threads=2), out=tmp_path / "two")
    assert differences(final_state(tmp_path / "one"), final_state(tmp_path / "two")) == []


def test_a_finished_run_says_how_to_extend_it(tmp_path):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    with pytest.raises(RunDirError, match="is finished at 512 steps; to extend it: apil resume .* --steps N"):
        resume(tmp_path / "r")


def test_an_existing_directory_is_not_touched(tmp_path):
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "thesis.txt").write_text("mine")
    with pytest.raises(RunDirError, match="exists and is not empty; choose another --out"):
        run(small_config("adrl"), out=tmp_path / "r")
    assert [p.name for p in (tmp_path / "r").iterdir()] == ["thesis.txt"]


def test_two_that_want_one_directory_at_once(tmp_path):
    (tmp_path / "r").mkdir()
    with (
        locked(tmp_path / "r" / ".lock", "taken"),
        pytest.raises(RunDirError, match="exists and is not empty"),
    ):
        run(small_config("adrl"), out=tmp_path / "r")
    assert [p.name for p in (tmp_path / "r").iterdir() if p.name != ".lock"] == []
    assert run(small_config("adrl", steps=512), out=tmp_path / "r").status == "finished"


def test_a_path_that_cannot_be_a_directory(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunDirError, match="cannot create run directory"):
        run(small_config("adrl"), out=tmp_path / "file" / "r")


def test_a_checkpoint_cut_short_is_named_and_the_one_before_works(tmp_path):
    run(small_config("adrl"), out=tmp_path / "r")
    newest, before = RunDir(tmp_path / "r").checkpoints()[::-1][:2]
    content = newest.read_bytes()
    newest.write_bytes(content[: len(content) // 2])
    with pytest.raises(RunDirError, match="damaged or cut short .*--checkpoint") as caught:
        resume(tmp_path / "r", steps=10_000)
    assert str(newest) in str(caught.value)
    assert str(before) in str(caught.value)
    assert newest.read_bytes() == content[: len(content) // 2]
    result = resume(tmp_path / "r", checkpoint_path=before)
    assert result.status == "finished"
    assert newest.read_bytes() != content[: len(content) // 2]


def test_a_checkpoint_of_a_newer_version_is_refused(tmp_path):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    path = RunDir(tmp_path / "r").newest_checkpoint()
    state = checkpoint.read(path)
    checkpoint.save(path, {**state, "format": checkpoint.FORMAT + 1})
    with pytest.raises(RunDirError, match="upgrade apil"):
        resume(tmp_path / "r", steps=2000)


def test_a_full_disk_keeps_the_last_checkpoint(tmp_path, monkeypatch):
    path = tmp_path / "state.pt"
    checkpoint.save(path, {"x": 1})

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint.torch, "save", full)
    with pytest.raises(RunDirError, match="No space left"):
        checkpoint.save(path, {"x": 2})
    monkeypatch.undo()
    assert checkpoint.read(path)["x"] == 1
    assert list(tmp_path.iterdir()) == [path]


def test_only_the_newest_checkpoints_stay(tmp_path):
    run(small_config("adrl", checkpoint={"every_iterations": 1, "keep": 3}), out=tmp_path / "r")
    names = [p.name for p in RunDir(tmp_path / "r").checkpoints()]
    assert names == [f"iteration-{i:08d}.pt" for i in (4, 5, 6)]


KEEPER = """
import torch
from apil_core import Method, MethodSpec, hookimpl

class Keeper(Method):
    def __init__(self, options, context):
        super().__init__(options, context)
        self.sums, self.mean = None, torch.zeros(3)

    @hookimpl
    def shape_reward(self, step):
        self.sums = torch.zeros_like(step.sparse[0]) if self.sums is None else self.sums
        self.sums, self.mean = self.sums + 1, self.mean + 1
        return {"nothing": self.sums * 0}

    def state_dict(self):
        return {"sums": self.sums, "mean": self.mean}

    def load_state_dict(self, state):
        self.sums, self.mean = state["sums"], state["mean"]

@hookimpl
def register_methods():
    return [MethodSpec("keeper", f"{__name__}:Keeper", requires=("adrl",))]
"""


def test_what_a_plugin_keeps_for_each_game_starts_fresh_with_another_number_of_games(tmp_path):
    (tmp_path / "keeper.py").write_text(KEEPER)
    made = {
        "plugins": (str(tmp_path / "keeper.py"),),
        "steps": 256,
        "ppo": {"num_steps": 16, "minibatches": 2},
    }
    run(small_config("keeper", num_envs=8, **made), out=tmp_path / "first")
    run(small_config("keeper", num_envs=4, init_from=tmp_path / "first", **made), out=tmp_path / "second")
    kept = final_state(tmp_path / "second")["methods"]["keeper"]
    assert kept["sums"].tolist() == [64.0] * 4  # 256 steps in 4 games
    assert kept["mean"].tolist() == [32.0 + 64.0] * 3


def test_a_run_killed_before_its_first_checkpoint_may_be_deleted(tmp_path):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    for path in RunDir(tmp_path / "r").checkpoints():
        path.unlink()
    with pytest.raises(RunDirError, match="nothing to continue .* delete it and begin again"):
        resume(tmp_path / "r")


def test_init_from_takes_the_networks_of_another_run(tmp_path):
    run(small_config("adrl"), out=tmp_path / "first")
    run(small_config("adrl", init_from=tmp_path / "first", seed=5, steps=512), out=tmp_path / "second")
    counts = [
        final_state(tmp_path / n)["builder"]["normalizers.own.moments.count"] for n in ("first", "second")
    ]
    assert float(counts[1]) > float(counts[0])
    with pytest.raises(ConfigError, match="init_from: .* observation groups"):
        run(small_config("apil", init_from=tmp_path / "first"), out=tmp_path / "third")
    assert not (tmp_path / "third").exists()


def test_init_from_leaves_behind_critics_that_the_new_method_has_no_use_for(tmp_path):
    further = {"apl": {"advantage_difference": True}}
    for name, method, source, options in (
        ("apl", "apl", None, further),
        ("adrl", "adrl", "apl", {}),
        ("e_apil", "e_apil", None, {}),
        ("apil", "apil", "e_apil", {}),
    ):
        start = tmp_path / source if source else None
        run(small_config(method, init_from=start, steps=1024, options=options), out=tmp_path / name)
    assert final_state(tmp_path / "apl")["learner"]["critics"].keys() == {"victim"}
    assert final_state(tmp_path / "adrl")["learner"]["critics"] == {}


def test_going_on_from_an_older_checkpoint_leaves_the_other_future(tmp_path):
    run(small_config("adrl", checkpoint={"every_iterations": 1, "keep": 3}), out=tmp_path / "r")
    older = RunDir(tmp_path / "r").checkpoints()[0]
    state = final_state(tmp_path / "r")
    resume(tmp_path / "r", checkpoint_path=older)
    names = [p.name for p in RunDir(tmp_path / "r").checkpoints()]
    assert names == [f"iteration-{i:08d}.pt" for i in (4, 5, 6)]
    assert differences(state, final_state(tmp_path / "r")) == []
    assert len(list(RunDir(tmp_path / "r").checkpoint_dir.glob("*.abandoned"))) == 2


def test_scores_of_a_future_that_was_left_are_not_the_runs(tmp_path):
    settings = {"checkpoint": {"every_iterations": 1, "keep": 5}, "evaluation": {"episodes": 8}}
    run(small_config("adrl", steps=1024, **settings), out=tmp_path / "r")
    resume(tmp_path / "r", steps=2048)
    directory = RunDir(tmp_path / "r")
    assert [score.trained_steps for score in final_scores(directory)] == [1024, 2048]
    resume(tmp_path / "r", checkpoint_path=directory.checkpoint_path(3), steps=2560)
    assert [score.trained_steps for score in final_scores(directory)] == [1024, 2560]
    assert (tmp_path / "r" / "result-2048.json.abandoned").is_file()


def test_a_run_killed_in_the_final_evaluation_of_an_extension_is_scored(tmp_path):
    config = small_config("adrl", evaluation={"episodes": 8}, steps=1024)
    run(config, out=tmp_path / "r")

    class Killed(Progress):
        def evaluation_progress(self, done, total):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        resume(tmp_path / "r", steps=2048, progress=Killed())
    assert RunDir(tmp_path / "r").summary()["status"] == "running or killed"
    assert json.loads((tmp_path / "r" / "result-1024.json").read_text())["steps"] == 1024
    result = resume(tmp_path / "r")
    assert (result.status, result.steps, result.evaluation.trained_steps) == ("finished", 2048, 2048)


def test_two_processes_cannot_train_in_one_directory(tmp_path):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    with (
        RunDir(tmp_path / "r").lock(),
        pytest.raises(RunDirError, match="another process is training in"),
    ):
        resume(tmp_path / "r", steps=2048)


@pytest.mark.parametrize(("bad", "message"), [({"steps": 0}, "--steps 0"), ({"threads": -1}, "--threads -1")])
def test_a_bad_resume_changes_nothing(tmp_path, bad, message):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    before = RunDir(tmp_path / "r").config_path.read_bytes()
    with pytest.raises(ConfigError, match=message):
        resume(tmp_path / "r", **bad)
    assert RunDir(tmp_path / "r").config_path.read_bytes() == before


def edit_config(path, old, new):
    text = RunDir(path).config_path.read_text()
    assert old in text
    RunDir(path).config_path.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("method: adrl", "method: apl", "method"),
        ("seed: 0", "seed: 1", "seed"),
        ("num_envs: 32", "num_envs: 16", "num_envs"),
    ],
)
def test_a_checkpoint_of_another_configuration_is_refused(tmp_path, old, new, named):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    edit_config(tmp_path / "r", old, new)
    with pytest.raises(RunDirError, match=f"is of another run or configuration: .*{named}") as caught:
        resume(tmp_path / "r", steps=2048)
    assert "\n" not in str(caught.value)


def test_a_config_cut_short_is_not_filled_with_defaults(tmp_path):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    path = RunDir(tmp_path / "r").config_path
    path.write_text(path.read_text()[:150])
    with pytest.raises(ConfigError, match=r"config.yaml: incomplete, lacks .*seed"):
        resume(tmp_path / "r", steps=2048)


def test_an_error_after_an_iteration_keeps_that_iteration(tmp_path, monkeypatch):
    class Full(Progress):
        def iteration(self, metrics):
            if metrics["iteration"] == 3:
                raise RunDirError("no space")

    config = small_config("adrl", checkpoint={"every_iterations": 100})
    with pytest.raises(RunDirError, match="no space"):
        run(config, out=tmp_path / "r", progress=Full())
    assert final_state(tmp_path / "r")["iteration"] == 3
    assert resume(tmp_path / "r").status == "finished"


def test_a_policy_that_became_nan_is_not_saved(tmp_path):
    wild = {"num_steps": 16, "epochs": 2, "minibatches": 2, "learning_rate": 1e30}
    with pytest.raises(ApilError, match="became NaN or infinite .* lower the learning rate"):
        run(small_config("adrl", ppo=wild, checkpoint={"every_iterations": 1}), out=tmp_path / "r")
    assert RunDir(tmp_path / "r").checkpoints() == []


def test_damaged_notes_do_not_stop_a_run(tmp_path):
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    RunDir(tmp_path / "r").environment_path.write_text("{")
    RunDir(tmp_path / "r").result_path.write_text("{")
    assert "result.json is damaged" in RunDir(tmp_path / "r").summary()["status"]
    RunDir(tmp_path / "r").result_path.unlink()
    assert resume(tmp_path / "r", steps=1024).status == "finished"


def test_the_stored_configuration_is_complete(tmp_path):
    run(small_config("apl", steps=512), out=tmp_path / "r")
    stored = RunDir(tmp_path / "r").config()
    assert stored.victim == "scripted:toy-pursuit/evader/v1"
    assert stored.victim_side == 0
    assert stored.reward.sparse_weight is not None
    assert stored.options == {"apl": {"advantage_difference": False}}


def test_linear_learning_rate_counts_side_games(tmp_path):
    ppo = {"num_steps": 16, "epochs": 1, "minibatches": 2, "learning_rate": 1.0e-4, "lr_schedule": "linear"}
    config = small_config("apil", ppo=ppo, options={"apil": {"rollouts": "own"}}, steps=4 * 1024)
    run(config, out=tmp_path / "r")
    rates = [m["ppo/learning_rate"] for m in metrics_of(tmp_path / "r")]
    assert rates == pytest.approx([1.0e-4, 0.75e-4, 0.5e-4, 0.25e-4])


def test_side_games_count_in_speed_and_plan(tmp_path):
    config = small_config("apil", options={"apil": {"rollouts": "own"}}, steps=4 * 1024)
    run(config, out=tmp_path / "r")
    for row in metrics_of(tmp_path / "r"):
        seconds = row["collect_seconds"] + row["update_seconds"]
        assert row["steps_per_second"] * seconds == pytest.approx(1024)
    assert dry_run(config, default_plugins()).iterations == 4
