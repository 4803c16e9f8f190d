"""From training to comparison, on the coin game."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bench.small_matrix import Here

from cli.cli_helpers import SMALL, TINY, Apil


def test_run_shows_progress_and_a_table(apil: Apil, tmp_path: Path) -> None:
    done = apil("run", *TINY, *SMALL, "--method", "e_apil", "--out", tmp_path / "r")
    assert done.code == 0
    lines = done.err.splitlines()
    assert lines[0].startswith("e_apil against baseline:zero/2x1 in coin, seed 0, 8 games × 16 steps → ")
    assert "iteration 2: 256 of 256 steps | " in done.err
    for part in ("steps/s", "win ", "returns: adversary", "D right on victim", "log-likelihood"):
        assert part in done.err
    for part in (
        "win or tie",
        "95 % interval",
        "endings ",
        "victim     baseline:zero/2x1 (sha256 ",
        "actions",
    ):
        assert part in done.out


def test_json_is_all_there_is_on_stdout(apil: Apil, tmp_path: Path) -> None:
    done = apil("run", *TINY, *SMALL, "--method", "adrl", "--out", tmp_path / "r", "--json")
    result = json.loads(done.out)
    assert (result["status"], result["steps"]) == ("finished", 256)
    assert result["evaluation"]["episodes"] == 20
    assert "iteration 1" in done.err


def test_quiet_shows_no_progress(apil: Apil, tmp_path: Path) -> None:
    done = apil("run", *TINY, *SMALL, "--method", "adrl", "--out", tmp_path / "r", "--quiet")
    assert done.err == ""
    assert "win or tie" in done.out


def test_seeds_train_together_are_compared_scored_and_extended(
    apil: Apil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("apil_core.cli.bench_run.Placement.start", lambda where, root: Here(root))
    out = tmp_path / "many"
    done = apil(
        "run", *TINY, *SMALL, "--method", "adrl", "--seeds", "0..1", "--out", out, "--quiet", "--json"
    )
    assert [Path(result["run_dir"]) for result in json.loads(done.out)] == [out / "s0", out / "s1"]
    listed = json.loads(apil("runs", "list", out, "--json").out)
    assert [(row["seed"], row["status"]) for row in listed] == [(0, "finished"), (1, "finished")]
    compared = json.loads(apil("runs", "compare", out / "s0", out / "s1", "--json").out)
    assert compared["rows"][0]["win_difference"] is None
    assert {"value", "low", "high", "within_noise"} == set(compared["rows"][1]["win_difference"])
    assert compared["spreads"][0]["seeds"] == [0, 1]
    assert compared["warnings"] == []
    assert "mean ± sd" in apil("runs", "compare", out).out
    scored = json.loads(apil("eval", out, "--episodes", "5", "--quiet", "--json").out)
    assert [score["adversary"]["name"] for score in scored] == [f"run:{out}/s0", f"run:{out}/s1"]
    assert "mean ± sd" in apil("eval", out, "--episodes", "5", "--quiet").out
    raised = apil("resume", out, "--steps", "512", "--quiet", "--json")
    assert [result["steps"] for result in json.loads(raised.out)] == [512, 512], raised.err


def test_resume_extends_a_finished_run(apil: Apil, trained: Path) -> None:
    refused = apil("resume", trained)
    assert refused.code == 2
    assert "is finished at 256 steps" in refused.err
    done = apil("resume", trained, "--steps", "512", "--quiet", "--json")
    assert (done.code, json.loads(done.out)["steps"]) == (0, 512)


def test_a_checkpoint_cut_short_is_refused_and_left_alone(apil: Apil, trained: Path) -> None:
    newest = sorted((trained / "checkpoints").iterdir())[-1]
    newest.write_bytes(newest.read_bytes()[:1000])
    before = {path: path.read_bytes() for path in trained.rglob("*") if path.is_file()}
    for verb in (("resume", trained, "--steps", "512"), ("eval", trained)):
        done = apil(*verb)
        assert done.code == 2
        loads, refused = done.err.splitlines()
        assert loads.startswith("apil: loads code: ")
        assert "damaged or cut short" in refused
    assert {path: path.read_bytes() for path in trained.rglob("*") if path.is_file()} == before


def test_eval_is_the_same_for_a_seed_at_any_number_of_threads(apil: Apil, trained: Path) -> None:
    results = []
    for threads in ("1", "2"):
        done = apil("eval", trained, "--episodes", "30", "--threads", threads, "--json", "--quiet")
        results.append(json.loads(done.out))
    for result in results:
        del result["wall_seconds"]
    assert results[0] == results[1]
    assert results[0]["wins"] + results[0]["ties"] + results[0]["losses"] == 30


def test_eval_prints_action_modes_and_hashes(apil: Apil, trained: Path) -> None:
    done = apil("eval", trained, "--episodes", "20", "--victim-actions", "mode", "--quiet")
    assert "(sha256 " in done.out
    assert "actions mode" in done.out


def test_an_unreadable_run_does_not_spoil_the_list(apil: Apil, trained: Path) -> None:
    (trained / "config.yaml").write_text("version: 99\n")
    done = apil("runs", "list", trained)
    assert done.code == 0
    assert "newer than this apil" in done.out


def test_ctrl_c_writes_a_checkpoint_and_says_how_to_go_on(tmp_path: Path) -> None:
    flags = [*TINY, *SMALL, "--method", "adrl", "--steps", "50M", "--out", str(tmp_path / "r")]
    flags.remove("256"), flags.remove("--steps")
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", "apil_core.cli", "run", *flags],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip
    assert process.stderr is not None
    seen = ""
    while "iteration 1" not in seen and process.poll() is None:
        seen += process.stderr.readline()
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == 130, seen + rest
    assert f"continue with: apil resume {tmp_path / 'r'}" in rest
    assert list((tmp_path / "r" / "checkpoints").glob("*.pt"))


@pytest.mark.parametrize(
    ("text", "number"), [("300k", 300_000), ("35M", 35_000_000), ("1e6", 10**6), ("1_0", 10)]
)
def test_steps_may_be_written_short(apil: Apil, text: str, number: int) -> None:
    done = apil("config", "show", *TINY[:4], "--steps", text, "--json")
    assert json.loads(done.out)["steps"] == number


def test_a_dry_run_builds_everything_and_says_what_it_costs(apil: Apil, tmp_path: Path) -> None:
    settings = ("--set", "evaluation.every_steps=1000", "--set", "evaluation.periodic_episodes=7")
    words = ("run", *TINY[:-4], "--steps", "10000", *SMALL, *settings, "--method", "adrl", "--dry-run")
    done = apil(*words, "--json", "--out", "r")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert (told["method"], told["env"], told["adversary_side"]) == ("adrl", "coin", "right")
    assert told["iterations"] == 79  # 10 000 / (8 · 16), rounded up
    assert (told["evaluations"], told["games"]) == (10, 20 + 10 * 7)
    assert told["training_hours"] == pytest.approx(10_000 / told["steps_per_second"] / 3600)
    few = json.loads(apil(*words, "--set", "ppo.minibatches=256", "--set", "ppo.num_steps=64", "--json").out)
    assert (few["iterations"], few["evaluations"]) == (20, 10)  # of 8 · 64 steps, measured with 8 · 64
    often = json.loads(apil(*words, "--set", "evaluation.every_steps=1", "--json").out)
    assert (often["iterations"], often["evaluations"]) == (79, 79)
    # actor and critic 2-64-64-1 each, a log standard deviation
    assert told["parameters"] == 2 * ((2 + 1) * 64 + 65 * 64 + 65) + 1
    assert 0 < told["disk_mb"] < told["disk_free_mb"]
    shown = apil(*words, "--seeds", "0..2")
    assert "in all" in shown.out
    assert "for 3 seeds" in shown.out
    assert list(tmp_path.iterdir()) == []
    wrong = apil(*words, "--victim", "sb3:none.zip")
    assert (wrong.code, wrong.out) == (2, "")
    assert "none.zip: no such file" in wrong.err
