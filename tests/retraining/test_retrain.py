"""A whole retraining on the toy game: it hardens, goes on bit for bit, and its victim plays everywhere."""

from __future__ import annotations

import json
import os
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.small_runs import differences, final_state, small_config

from apil_core import ConfigError, RunConfig, RunDirError, VictimError, evaluate, load_policy, resume, run
from apil_core.api.config import PPOConfig
from apil_core.evaluation.progress import Progress
from apil_core.plugins.registry import default_plugins
from apil_core.runs.retraining.build import prepare
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.runs.retraining.retrain import resume_retraining as go_on
from apil_core.runs.retraining.retrain import retrain
from apil_core.runs.retraining.settings import settings
from apil_core.runs.trackers.tracked import TrackedRun
from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir
from retraining.victims import student

SMALL: dict[str, Any] = {
    **{"steps": 4 * 512, "baseline": "random", "threads": 1},
    **{"critic_warmup": 0, "evaluation.episodes": 0, "recorders": ["jsonl"]},
    **{"num_envs": 32, "ppo.num_steps": 16, "ppo.minibatches": 2},
}

BOTH = ("noise", "adrl")
WATCHED = {
    **{"evaluation__every_steps": 1024, "evaluation__periodic_episodes": 20},
    "adversary_share": 0.8,
}


@pytest.fixture(scope="module")
def attacks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Adversaries of an LSTM evader: one plain, one whose hooks draw random numbers."""
    path = tmp_path_factory.mktemp("attacks")
    victim = student(path / "evader.safetensors")
    made = {}
    for name, method, options in (("adrl", "adrl", {}), ("noise", "apil", {"apil": {"prediction": "noise"}})):
        made[name] = path / name
        run(small_config(method, victim=victim, steps=512, options=options), out=made[name])
    return made


def config(attacks: dict[str, Path], *names: str, **flags: Any) -> RetrainConfig:
    dotted = {key.replace("__", "."): value for key, value in flags.items()}
    return settings([attacks[name] for name in names or ("adrl",)], {**SMALL, **dotted})


def rows_of(path: Path) -> list[dict[str, float]]:
    """Metrics without what depends on the machine and on how the steps were divided."""
    rows = read_metrics(RetrainDir(path).metrics_path)
    aside = ("memory_mb", "total_steps")
    return [{k: v for k, v in row.items() if "second" not in k and k not in aside} for row in rows]


@pytest.fixture(scope="module")
def whole(attacks: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A retraining against both adversaries, in one go."""
    path = tmp_path_factory.mktemp("retrained") / "whole"
    retrain(config(attacks, *BOTH, **WATCHED), out=path)
    return path


def test_the_game_comes_from_the_run_the_learner_does_not(attacks: dict[str, Path]) -> None:
    made = settings([attacks["noise"], attacks["adrl"]], {"baseline": "random"})
    attack = RunDir(attacks["noise"]).config()
    assert (made.env, made.victim_side, made.game) == ("toy-pursuit", 0, attack.game)
    assert (attack.num_envs, attack.ppo.num_steps) == (32, 16)
    paper = RunConfig.load(presets=["paper"])
    assert (made.num_envs, made.ppo) == (128, PPOConfig())
    assert (made.num_envs, made.ppo) == (paper.num_envs, paper.ppo)
    assert made.victim.startswith("safetensors:/")
    assert made.labels == ("apil", "adrl", "baseline")
    assert all(name.startswith("run:/") and name.endswith(".pt") for name in made.adversaries)


def test_without_updates_nothing_changes_in_play(attacks: dict[str, Path], tmp_path: Path) -> None:
    still = config(attacks, steps=1024, ppo__learning_rate=1e-30, evaluation__episodes=40)
    result = retrain(still, out=tmp_path / "r")
    original = load_policy(still.victim)
    assert result.hardened.sha256 == result.victim.sha256 == original.info.sha256
    kept = load_policy(f"retrained:{tmp_path / 'r'}")
    assert all(torch.equal(kept.weights[name], tensor) for name, tensor in original.weights.items())
    for label in ("adrl", "baseline"):
        before, after = result.before[label], result.after[label]
        same = ("wins", "ties", "losses", "causes", "mean_length", "seed", "num_envs")
        assert [getattr(before, key) for key in same] == [getattr(after, key) for key in same]


def test_an_extended_retraining_is_bit_exact(attacks: dict[str, Path], tmp_path: Path) -> None:
    whole = retrain(config(attacks, *BOTH, mix="per_step"), out=tmp_path / "whole")
    retrain(config(attacks, *BOTH, mix="per_step", steps=1024), out=tmp_path / "parts")
    resumed = go_on(tmp_path / "parts", steps=whole.steps)
    assert (resumed.status, resumed.steps) == ("finished", whole.steps)
    assert differences(final_state(tmp_path / "whole"), final_state(tmp_path / "parts")) == []
    assert resumed.hardened.sha256 == whole.hardened.sha256 != whole.victim.sha256
    rows = rows_of(tmp_path / "whole")
    assert rows == rows_of(tmp_path / "parts")
    assert rows[-1]["opponent/mixed/games"] == rows[-1]["games_total"]


@pytest.mark.parametrize("moment", ["iteration", "evaluation"])
def test_ctrl_c_leaves_a_checkpoint_to_go_on_from(
    attacks: dict[str, Path], whole: Path, tmp_path: Path, moment: str
) -> None:
    """In a due evaluation as well: it is played to its end."""

    class Impatient(Progress):
        asked = False

        def iteration(self, metrics: dict[str, float]) -> None:
            if metrics["iteration"] == 3 and moment == "iteration":
                os.kill(os.getpid(), signal.SIGINT)

        def evaluation_progress(self, done: int, total: int) -> None:
            if moment == "evaluation" and not self.asked:
                self.asked = True
                os.kill(os.getpid(), signal.SIGINT)

    stopped = retrain(config(attacks, *BOTH, **WATCHED), out=tmp_path / "parts", progress=Impatient())
    assert (stopped.status, stopped.steps) == ("interrupted", {"iteration": 3, "evaluation": 2}[moment] * 512)
    assert load_policy(f"retrained:{tmp_path / 'parts'}").info.sha256 == stopped.hardened.sha256
    go_on(tmp_path / "parts")
    assert differences(final_state(whole), final_state(tmp_path / "parts")) == []
    assert rows_of(whole) == rows_of(tmp_path / "parts")


def test_rows_count_games_by_opponent(whole: Path) -> None:
    rows = rows_of(whole)
    assert [row["steps"] for row in rows] == [512 * i for i in range(1, 5)]
    last = rows[-1]
    counts = {label: last[f"opponent/{label}/games"] for label in ("adrl", "apil", "baseline")}
    assert sum(counts.values()) == last["games_total"] == sum(row["games"] for row in rows)
    played = [counts[label] / last["games_total"] for label in counts]
    # of about 80 games: two standard errors of a share are 0.11
    assert played == pytest.approx([0.4, 0.4, 0.2], abs=0.11)
    for label in counts:
        assert last[f"opponent/{label}/wins"] + last[f"opponent/{label}/ties"] <= counts[label]
    assert [row["steps"] for row in rows if "evaluation/apil/games" in row] == [1024, 2048]


def test_trackers_know_it_by_game_and_kind(whole: Path) -> None:
    tracked = TrackedRun.of(whole)
    assert (tracked.name, tracked.group) == ("whole", "toy-pursuit/retraining")
    assert tracked.config["adversary_share"] == 0.8


def test_settings_that_were_edited_are_not_those_of_the_checkpoint(whole: Path, tmp_path: Path) -> None:
    edited = tmp_path / "edited"
    shutil.copytree(whole, edited)
    file = edited / "config.yaml"
    for old, new, message in (
        ("adversary_share: 0.8", "adversary_share: 0.9", r"adversary_share \(0.8 there, 0.9 here\)"),
        ("gamma: 0.99", "gamma: 0.9", r"ppo.gamma \(0.99 there, 0.9 here\)"),
    ):
        text = file.read_text()
        assert text.count(old) == 1
        file.write_text(text.replace(old, new))
        with pytest.raises(RunDirError, match=f"is of another run or configuration: {message}"):
            go_on(edited, steps=4096)
        file.write_text(text)


def test_the_hardened_victim_is_a_victim(attacks: dict[str, Path], tmp_path: Path, monkeypatch: Any) -> None:
    made = tmp_path / "hard"
    result = retrain(config(attacks, evaluation__episodes=30, steps=512), out=made)
    stored = json.loads((made / "result.json").read_text())
    assert stored["after"]["adrl"]["victim"]["sha256"] == result.hardened.sha256
    monkeypatch.chdir(tmp_path)
    for name in ("retrained:hard", "hard"):
        score = evaluate(attacks["adrl"], victim=name, episodes=30, threads=1)
        assert score.victim.name == f"retrained:{made}"
        assert (score.wins, score.ties) == (result.after["adrl"].wins, result.after["adrl"].ties)
    run(small_config("adrl", victim="hard", steps=512), out=tmp_path / "again")
    assert RunDir(tmp_path / "again").config().victim == f"retrained:{made}"
    twice = retrain(settings([tmp_path / "again"], {**SMALL, "steps": 512}), out=tmp_path / "twice")
    assert twice.victim.sha256 == result.hardened.sha256
    go_on(made, steps=2048)  # the toy games of 50 steps have ended by then
    with pytest.raises(VictimError, match="has changed since the run began"):
        resume(tmp_path / "again", steps=1024)
    with pytest.raises(VictimError, match="has changed since the retraining began: SHA-256 "):
        go_on(tmp_path / "twice", steps=1024)
    with pytest.raises(RunDirError, match="hard is a retraining, no run; its victim is retrained:"):
        RunDir(made).config()


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (
            {"baseline": None},
            "has no baseline adversary for the pursuer: name one with --baseline",
        ),
        ({"victim": "random"}, "baseline:random/7x2 cannot be retrained; what can: zoo:"),
        ({"adversary_share": 1.5}, "--adversary-share 1.5: should be less than or equal to 1, got 1.5"),
        ({"freeze": "value"}, "--freeze value needs the victim's own value network"),
        ({"critic": "stored"}, "brings no value network"),
        ({"env": "coin"}, "the adversaries were trained on toy-pursuit; they cannot play coin"),
        (
            {"baseline": "baseline:zero/380x17"},
            "takes 380 observations and gives 17 actions",
        ),
        ({"num_envs": 1}, r"num_envs \(1\) must be at least ppo.minibatches \(2\)"),
        ({"victim": "retrained:nowhere"}, "nowhere is none"),
    ],
)
def test_a_mistake_is_one_line_before_anything_is_made(
    attacks: dict[str, Path], tmp_path: Path, flags: dict[str, Any], message: str
) -> None:
    with pytest.raises((ConfigError, VictimError), match=message) as caught:
        retrain(config(attacks, **flags), out=tmp_path / "r")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "r").exists()


def test_one_that_an_older_version_began_is_refused_and_its_victim_still_plays(
    whole: Path, tmp_path: Path
) -> None:
    """Version 1 had the reward's two settings at the top, and checkpoints of a learner of its own."""
    old = tmp_path / "old"
    shutil.copytree(whole, old)
    text = (old / "config.yaml").read_text()
    reward = text[text.index("reward:\n") : text.index("ppo:\n")]
    assert text.count("version: 2") == 1
    (old / "config.yaml").write_text(
        text.replace(reward, "sparse_weight: 0.02\nnormalize_reward: false\n").replace(
            "version: 2", "version: 1"
        )
    )
    stored = RetrainDir(old).config()
    assert (stored.version, stored.reward.sparse_weight, stored.reward.normalize) == (1, 0.02, False)
    with pytest.raises(RunDirError, match=r"old was begun by an older version; its victim stays retrained:"):
        go_on(old, steps=4096)
    assert load_policy(f"retrained:{old}").info.sha256 == load_policy(f"retrained:{whole}").info.sha256


def test_what_only_runs_have_is_no_setting(attacks: dict[str, Path]) -> None:
    for key, value in (("observers", "[x]"), ("reward.dense_weight", "1"), ("ppo.critic_observes", "both")):
        with pytest.raises(ConfigError, match=f"{key} is no setting of a retraining"):
            settings([attacks["adrl"]], SMALL, [f"{key}={value}"])


def test_without_a_baseline_the_adversaries_may_play_alone(attacks: dict[str, Path], tmp_path: Path) -> None:
    alone = config(attacks, baseline=None, adversary_share=1.0, steps=512, evaluation__episodes=5)
    result = retrain(alone, out=tmp_path / "r")
    assert list(result.after) == ["adrl"]
    assert result.shares == {"adrl": 1.0}


def test_rollouts_without_an_outcome_are_no_warm_up(attacks: dict[str, Path]) -> None:
    brief = config(attacks, num_envs=4, ppo__num_steps=1, ppo__minibatches=2, critic_warmup=2)
    trainer = prepare(brief, default_plugins())
    actor = [p.clone() for p in trainer.learner.policy.parameters()]
    learnt, empty = 0, 0
    while learnt < 2:
        if "ppo/value" in trainer.iterate():
            learnt += 1
        else:
            empty += 1
    assert empty > 2
    assert trainer.state_dict()["warmup"] == 2 + empty
    assert all(map(torch.equal, actor, trainer.learner.policy.parameters()))
    trainer.iterate()
    assert not all(map(torch.equal, actor, trainer.learner.policy.parameters()))


def test_python_takes_one_adversary_and_the_commands_short_names(
    attacks: dict[str, Path], tmp_path: Path
) -> None:
    small = {key: value for key, value in SMALL.items() if key not in ("steps", "evaluation.episodes")}
    made = retrain(attacks["adrl"], out=tmp_path / "r", steps=512, episodes=5, **small)
    assert made.after["adrl"].episodes == 5
    with pytest.raises(RunDirError, match="is a retraining, no run; .* resume_retraining goes on with it"):
        resume(tmp_path / "r", steps=1024)
    assert go_on(tmp_path / "r", steps=1024).steps == 1024


def test_baselines_are_adversaries_by_their_short_names() -> None:
    found = settings(["random", "zero"], {"env": "toy-pursuit"})
    assert (found.adversaries, found.labels) == (("random", "zero"), ("random", "zero", "baseline"))


def test_a_kill_before_the_first_checkpoint_keeps_the_scores_before(
    attacks: dict[str, Path], tmp_path: Path
) -> None:
    class Killed(Progress):
        def iteration(self, metrics: dict[str, float]) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        retrain(config(attacks, evaluation__episodes=5), out=tmp_path / "r", progress=Killed())
    assert [path.stem for path in RetrainDir(tmp_path / "r").checkpoints()] == ["iteration-00000000"]
    assert list(go_on(tmp_path / "r").before) == ["adrl", "baseline"]
