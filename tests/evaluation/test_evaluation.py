"""Scores: what is counted, that short games are not over-represented, that a seed fixes them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from helpers.small_runs import small_config

from apil_core import ApilError, Decision, GameStep, evaluate, make_game, run
from apil_core.evaluation.play import Players, Seat, play
from apil_core.evaluation.results import wilson


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "r"
    run(small_config("e_apil"), out=path)
    return path


def test_wilson_by_hand():
    # n = 100, p = .5, z = 1.96: centre .5, half width z √(p(1−p)/n + z²/4n²) / (1 + z²/n) = .09617
    rate = wilson(50, 100)
    assert (rate.low, rate.high) == (pytest.approx(0.40383, abs=1e-4), pytest.approx(0.59617, abs=1e-4))
    assert wilson(0, 10).low == 0.0
    assert wilson(10, 10).high == 1.0


def test_a_score_says_all_it_depends_on(trained):
    result = evaluate(trained, episodes=50, seed=3)
    assert result.wins + result.ties + result.losses == 50 == sum(result.causes.values())
    assert result.win_rate.low <= result.win_rate.value <= result.win_rate.high
    assert result.victim.name == "scripted:toy-pursuit/evader/v1"
    assert len(result.victim.sha256) == len(result.adversary.sha256) == 64
    assert (result.adversary_actions, result.victim_actions) == ("sample", "sample")
    assert result.trained_steps == 3072
    assert {"apil", "mujoco", "torch", "numpy"} <= result.versions.keys()


def outcome(result):
    return (result.wins, result.ties, result.losses, result.causes, result.mean_length)


def test_a_seed_fixes_the_score_at_any_thread_count(trained):
    scores = [outcome(evaluate(trained, episodes=60, seed=1, threads=n)) for n in (1, 2, 4)]
    assert scores[0] == scores[1] == scores[2]
    assert outcome(evaluate(trained, episodes=60, seed=2)) != scores[0]


def test_action_modes_change_the_games(trained):
    sampled = evaluate(trained, episodes=60)
    mode = evaluate(trained, episodes=60, adversary_actions="mode", victim_actions="mode")
    assert (mode.adversary_actions, mode.victim_actions) == ("mode", "mode")
    assert outcome(mode) != outcome(sampled)


@pytest.mark.parametrize(
    ("adversary", "options", "message"),
    [
        ("no-such-run", {}, "neither a run directory nor a policy name"),
        ("zoo:kick-and-defend/defender/v1", {}, "say which game .* --env GAME"),
        ("scripted:toy-pursuit/evader/v1", {"env": "toy-pursuti"}, "did you mean 'toy-pursuit'"),
        ("nonsense:x", {"env": "toy-pursuit"}, "unknown policy 'nonsense:x'"),
        (None, {"episodes": 0}, "episodes must be at least 1"),
        (None, {"env": "kick-and-defend"}, "was trained on toy-pursuit"),
        (None, {"device": "tpu"}, "device: 'tpu'"),
        (None, {"device": "cuda"}, "torch sees no CUDA GPU|"),
    ],
)
def test_mistakes(trained, adversary, options, message):
    if options.get("device") == "cuda" and torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(ApilError, match=message) as caught:
        evaluate(adversary or trained, **options)
    assert "\n" not in str(caught.value)


class Scheduled:
    """A game whose n-th episode is decided beforehand: odd ones are short and won by side 1."""

    def __init__(self, num_envs):
        self.num_envs = num_envs
        self.observations = (np.zeros((num_envs, 1), np.float32),) * 2
        self.started = 0
        self.number = np.zeros(num_envs, int)
        self.time = np.zeros(num_envs, int)
        self.stepped_idle = 0

    def reset(self, mask=None):
        mask = np.ones(self.num_envs, bool) if mask is None else mask
        for i in np.flatnonzero(mask):
            self.number[i], self.time[i] = self.started, 0
            self.started += 1

    def step(self, actions, active=None):
        active = np.ones(self.num_envs, bool) if active is None else active
        self.time += active
        length = np.where(self.number % 2 == 1, 2, 30)
        done = active & (self.time >= length)
        zeros = np.zeros((2, self.num_envs), np.float32)
        winner = np.where(self.number % 2 == 1, 1, 0).astype(np.int8)
        cause = np.zeros(self.num_envs, np.int8)
        return GameStep(zeros, zeros, zeros, done, winner, cause, self.time.astype(np.int32))


class Still:
    def act(self, view, **_):
        return Decision(torch.zeros(len(view.own), 1))


@pytest.mark.parametrize(("slots", "episodes"), [(7, 40), (16, 16), (3, 100), (50, 20)])
def test_short_games_are_not_over_represented(slots, episodes):
    seat = Seat(Still(), False, torch.Generator())
    players = Players((seat, seat), adversary_side=1, device=torch.device("cpu"))
    tally = play(Scheduled(slots), players, episodes)
    assert len(tally.winners) == episodes
    assert tally.winners.count(1) == episodes // 2
    assert sorted(set(tally.lengths)) == [2, 30]


def test_a_score_of_a_named_policy_names_every_game_option():
    result = evaluate("baseline:random/7x2", env="toy-pursuit", episodes=5)
    assert "max_steps" in result.game_options
    assert result.adversary.name == "baseline:random/7x2"


def test_the_games_own_baseline_can_be_scored():
    game = make_game("toy-pursuit", num_envs=4)
    assert game.layout.sides[0].name
    with pytest.raises(ApilError, match="takes .* observations and gives .* actions, but"):
        evaluate("baseline:zero/3x2", env="toy-pursuit", episodes=2)


def test_streams_of_one_seed_are_independent():
    from apil_core.common.seeds import stream_generator

    names = (
        "evaluation seat 0",
        "evaluation seat 1",
        "evaluation hooks",
        "training victim",
        "training method",
    )
    draws = torch.stack(
        [torch.randn(4000, generator=stream_generator(0, n, torch.device("cpu"))) for n in names]
    )
    correlation = torch.corrcoef(draws) - torch.eye(len(names))
    assert float(correlation.abs().max()) < 0.06
    again = torch.randn(4000, generator=stream_generator(0, names[0], torch.device("cpu")))
    assert torch.equal(again, draws[0])
