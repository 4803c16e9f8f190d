"""``apil tune``: spaces, trials, pruning, failures, resuming and workers, on the toy game."""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys

import pytest
from helpers.small_runs import metrics_of

from apil_core import ApilError, Method, RunConfig, evaluate, hookimpl, load_run, run, tune
from apil_core.plugins import defined
from apil_core.plugins.registry import default_plugins
from apil_core.studies.tune.space import Space, space_names

pytest.importorskip("optuna")

QUICK = {
    "method": "adrl",
    "env": "toy-pursuit",
    "steps": 1024,
    "num_envs": 8,
    "ppo": {"num_steps": 16, "epochs": 2, "minibatches": 2},
    "evaluation": {"episodes": 40, "every_steps": 256, "periodic_episodes": 20},
    "checkpoint": {"every_iterations": 2},
    "recorders": ["jsonl"],
    "threads": 1,
}
SPACE = {
    "ppo.learning_rate": {"low": 1e-5, "high": 1e-2, "log": True},
    "ppo.epochs": {"low": 1, "high": 4},
    "ppo.noise": ["white", "ar1"],
}


def quick(**changes):
    return RunConfig.load(**{**QUICK, **changes})


def told(result):
    """What a study found, without its place."""
    return [{key: value for key, value in row.items() if key != "run"} for row in result.rows]


@pytest.fixture(autouse=True)
def _forgotten():
    yield
    defined.defined.clear()


class TestSpace:
    @pytest.mark.parametrize("name", ["adrl", "apl", "apil", "e_apil"])
    def test_each_method_has_one_that_holds_the_presets_values(self, name):
        config = RunConfig.load("efficient", method=name, env="toy-pursuit")
        space = Space(name, config, default_plugins())
        default = space.default()
        assert default is not None
        assert default["ppo.learning_rate"] == 3e-4
        assert space.with_values(default, "test") == config

    def test_the_shipped_ones(self):
        assert space_names() == ["adrl", "apil", "apl", "e_apil"]

    @pytest.mark.parametrize(
        ("text", "lines"),
        [
            (
                "ppo.clip: [0.1, 0.2]\nppo.epohs: [1, 2]\nppo.noise: [white, pink]\n",
                [
                    ":2: ppo.epohs: unknown key (did you mean 'epochs'?)",
                    ":3: ppo.noise: should be 'white', 'ar1' or 'coloured', got 'pink'",
                ],
            ),
            (
                "ppo.gamma: {low: 0.9, high: 1.1}\n",
                [":1: ppo.gamma: should be less than or equal to 1, got 1.1"],
            ),
            ("ppo.epochs: {low: 1.0, high: 2.5}\n", [":1: ppo.epochs: should be a whole number, got 2.5"]),
            ("ppo.clip: {low: 0.3, high: 0.1}\n", [":1: ppo.clip: low (0.3) must be below high (0.1)"]),
            ("ppo.clip: {low: 0, high: 1, log: true}\n", [":1: ppo.clip: log needs a low above 0"]),
            (
                "ppo.clip:\n  low: 0.1\n  hi: 0.2\n",
                [":1: ppo.clip.high: missing", ":3: ppo.clip.hi: unknown key"],
            ),
            ("ppo.clip: 0.2\n", [":1: ppo.clip: expected a list of choices, or low and high"]),
            ("ppo.clip: []\n", [":1: ppo.clip: expected a list of choices, or low and high"]),
            ("seed: [1, 2]\n", [":1: seed: is the same in all trials"]),
            ("evaluation.episodes: [1, 2]\n", [":1: evaluation.episodes: is the same in all trials"]),
            ("options.apl.advantage_difference: [true]\n", ["method 'adrl' does not use 'apl'"]),
            ("- 1\n", [":1: expected keys and values, got list"]),
            ("", [": no key is left to vary"]),
        ],
    )
    def test_mistakes_are_found_before_anything_runs(self, tmp_path, text, lines):
        file = tmp_path / "space.yaml"
        file.write_text(text)
        with pytest.raises(ApilError) as error:
            Space(file, quick(), default_plugins())
        found = str(error.value).splitlines()
        assert len(found) == len(lines)
        assert all(line in said for line, said in zip(lines, found, strict=True)), found

    def test_a_name_that_is_none(self):
        with pytest.raises(ApilError, match=r"no space that ships with apil \(did you mean 'e_apil'"):
            Space("e_apill", quick(), default_plugins())


class TestStudy:
    def test_trials_are_runs_and_the_best_is_a_config_with_its_score(self, tmp_path):
        lines = []
        result = tune(SPACE, quick(), trials=4, out=tmp_path / "study", note=lines.append)
        assert (result.status, len(result.rows), len(lines)) == ("finished", 4, 4)
        assert result.rows[0]["ppo.learning_rate"] == 3e-4  # the settings as they are come first
        assert result.rows[0]["ppo.epochs"] == 2
        rates = [row["win_rate"] for row in result.rows]
        assert result.win_rate == max(rates) == rates[result.number]
        for row in result.rows:
            trial = load_run(row["run"])
            assert trial.config.ppo.learning_rate == row["ppo.learning_rate"]
            evaluations = [
                line["evaluation/win"] for line in metrics_of(trial.path) if "evaluation/win" in line
            ]
            assert (len(evaluations), evaluations[-1]) == (4, row["win_rate"])
        assert (result.path / "importances.png").read_bytes()[:4] == result.plot().data[:4] == b"\x89PNG"
        again = run(RunConfig.load(result.path / "best.yaml"), out=tmp_path / "again")
        assert again.evaluation.wins == result.scores["best"].wins
        assert result.scores["best"].episodes == 40
        default = run(quick(), out=tmp_path / "default")
        assert default.evaluation.wins == result.scores["default"].wins
        assert RunConfig.load(result.path / "best.yaml") == result.best

    @pytest.mark.slow
    def test_interrupted_and_continued_it_finds_the_same(self, tmp_path):
        class Interrupting(Method):
            """Ctrl-C in the fourth iteration of the third trial, once."""

            calls = 0

            @hookimpl
            def shape_reward(self, run, step):
                Interrupting.calls += 1
                if Interrupting.calls == (2 * 8 + 4) * 16:
                    os.kill(os.getpid(), signal.SIGINT)
                return {}

        config = quick(method=Interrupting)
        first = tune(SPACE, config, trials=4, out=tmp_path / "a")
        assert [row["state"] for row in first.rows] == ["complete", "complete", "interrupted"]
        assert (first.status, list(first.scores)) == ("interrupted", [])
        second = tune(SPACE, config, out=tmp_path / "a")  # as many trials as before
        whole = tune(SPACE, config, trials=4, out=tmp_path / "b")
        assert told(second) == told(whole)
        assert second.scores["best"].wins == whole.scores["best"].wins
        steps = [line["steps"] for line in metrics_of(load_run(second.rows[2]["run"]).path)]
        assert steps == [128 * i for i in range(1, 9)]
        more = tune(SPACE, config, trials=5, out=tmp_path / "a")
        assert told(more)[:4] == told(whole)

    def test_a_trial_that_fails_is_that_trials_failure(self, tmp_path):
        space = {"ppo.learning_rate": [3e-4, 1e30]}
        result = tune(space, quick(), trials=4, out=tmp_path / "study")
        states = {row["ppo.learning_rate"]: row["state"] for row in result.rows}
        assert states == {3e-4: "complete", 1e30: "failed"}
        error = next(row["error"] for row in result.rows if row["state"] == "failed")
        assert "NaN or infinite" in error
        assert result.best.ppo.learning_rate == 3e-4

    def test_other_settings_are_another_study(self, tmp_path):
        out = tmp_path / "study"
        tune(SPACE, quick(), trials=1, out=out)
        with pytest.raises(
            ApilError, match=r"begun with ppo.gamma 0.99, now it is 0.9; choose another --out"
        ):
            tune(SPACE, quick(**{"ppo.gamma": 0.9}), out=out)
        with pytest.raises(ApilError, match="begun with the search space another"):
            tune({"ppo.epochs": [1, 2]}, quick(), out=out)
        with pytest.raises(ApilError, match="exists and is no study"):
            tune(SPACE, quick(), out=out / "trials" / "0000")
        with pytest.raises(ApilError, match="no trial has a score"):
            tune(SPACE, quick(**{"evaluation.every_steps": 2000}), out=out)

    def test_a_class_of_this_process_has_one_worker(self, tmp_path):
        class Mine(Method):
            """Nothing."""

        with pytest.raises(ApilError, match="'mine' is this process's: workers must be 1"):
            tune(SPACE, quick(method=Mine), workers=2, out=tmp_path / "study")

    @pytest.mark.slow
    def test_what_falls_below_the_median_is_pruned(self, tmp_path):
        space = {"ppo.learning_rate": [1e-9, 1e-2], "ppo.epochs": {"low": 4, "high": 8}}
        config = quick(steps=2048, **{"ppo.learning_rate": 1e-2, "ppo.epochs": 8})
        result = tune(space, config, trials=10, out=tmp_path / "study")
        runs = [load_run(row["run"]) for row in result.rows]
        rates = [
            [line["evaluation/win"] for line in metrics_of(r.path) if "evaluation/win" in line] for r in runs
        ]
        pruned = [row["number"] for row in result.rows if row["state"] == "pruned"]
        assert pruned
        for number, own in enumerate(rates):
            whole = [rates[other] for other in range(number) if other not in pruned]
            if len(whole) < 5:
                assert number not in pruned
                continue
            for count in range(3, min(len(own), 7) + 1):  # the last evaluation ends a run anyway
                behind = max(own[:count]) < statistics.median(other[count - 1] for other in whole)
                assert behind == (number in pruned and count == len(own)), (number, count)
        for number in pruned:
            ended = runs[number].result
            assert (
                ended["stopped"] == f"pruned at {rates[number][-1]:.1%} wins, evaluation {len(rates[number])}"
            )
            assert ended["steps"] == 256 * len(rates[number])
            assert evaluate(runs[number], episodes=10).episodes == 10


@pytest.mark.slow
class TestProcesses:
    def test_after_a_kill_it_goes_on(self, tmp_path):
        command = [sys.executable, "-c", "import apil_core, test_tune; test_tune.in_a_process()"]
        environment = {**os.environ, "PYTHONPATH": os.path.dirname(__file__), "STUDY": str(tmp_path / "a")}
        process = subprocess.Popen(command, env=environment)
        while not list((tmp_path / "a/trials/0001/checkpoints").glob("iteration-*")):
            assert process.poll() is None
        process.kill()
        process.wait()
        killed = tune(SPACE, quick(), trials=3, out=tmp_path / "a")
        assert told(killed) == told(tune(SPACE, quick(), trials=3, out=tmp_path / "b"))

    def test_two_workers_share_the_trials(self, tmp_path):
        result = tune(SPACE, quick(), trials=6, workers=2, out=tmp_path / "study")
        assert [row["number"] for row in result.rows] == list(range(6))
        assert {row["state"] for row in result.rows} <= {"complete", "pruned"}
        hosts = [
            json.loads((load_run(row["run"]).path / "environment.json").read_text()) for row in result.rows
        ]
        assert all(len(sessions) == 1 for sessions in hosts)
        # random trials do not depend on which worker is first
        alone = tune(SPACE, quick(), trials=2, out=tmp_path / "alone")
        assert told(result)[:2] == told(alone)


def in_a_process():
    tune(SPACE, quick(), trials=3, out=os.environ["STUDY"])
