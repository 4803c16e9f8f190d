"""Blinding an adversary: what is replaced by what, and that a score says so."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import pytest
import torch
from helpers.made_plugins import registry_with
from helpers.small_runs import small_config

from apil_apil.imitator import Imitator
from apil_core import ApilError, GameSpec, Method, View, evaluate, hookimpl, make_game, run
from apil_core.evaluation.blinding import typical_start
from apil_core.evaluation.play import Blinding
from apil_core.plugins.hook_manager import RunHookManager
from evaluation.spy import play_spied, spied_pairing

EVADER, PURSUER = 0, 1
OPPONENT = [2, 3]
OWN = [0, 1, 4, 5, 6]


def view():
    return View(
        own=torch.tensor([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        opponent=torch.tensor([[7.0, 8.0], [9.0, 10.0]]),
        first=torch.tensor([True, False]),
        opponent_action=torch.tensor([[0.5], [0.6]]),
    )


def test_by_hand():
    blinding = Blinding(torch.tensor([False, True, True]), torch.tensor([-9.0, 0.25, -1.0]))
    original, shown = view(), blinding(view())
    assert shown.own.tolist() == [[1.0, 0.25, -1.0], [4.0, 0.25, -1.0]]
    assert torch.equal(shown.opponent, original.opponent)
    assert torch.equal(shown.opponent_action, original.opponent_action)
    assert torch.equal(shown.first, original.first)


def test_by_hand_with_the_imitator():
    blinding = Blinding(torch.tensor([False, True, True]), torch.zeros(3), torch.tensor([0.1, 0.2]))
    given = view()
    shown = blinding(given)
    assert shown.own.tolist() == [[1.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
    assert torch.equal(shown.opponent, torch.tensor([[0.1, 0.2], [0.1, 0.2]]))
    assert shown.opponent_action.tolist() == [[0.0], [0.0]]
    assert given.own[0, 1] == 2.0, "the given view is not to change"
    given.opponent_action = None
    assert blinding(given).opponent_action is None


def test_a_typical_start_of_toy_pursuit():
    # evader at (−.7, 0) and pursuer at (.1, 0) on average, the gate at (.95, 0), all of the time left;
    # .05 is four deviations of the mean of the widest, ±.5 − ±.4 over 1024 starts, and more of the others
    pairing = spied_pairing(make_game("toy-pursuit", num_envs=10), PURSUER)
    evader, pursuer = typical_start(pairing)
    assert evader.tolist() == pytest.approx([-0.7, 0, 0.8, 0, 1.65, 0, 1], abs=0.05)
    assert pursuer.tolist() == pytest.approx([0.1, 0, -0.8, 0, 0.85, 0, 1], abs=0.05)
    assert pursuer.dtype == torch.float32


def hooks_with(filter_observation):
    plugin = type("Plugin", (), {"filter_observation": staticmethod(hookimpl(filter_observation))})
    return RunHookManager((), {"filter": plugin()})


def test_blinding_comes_after_the_filters():
    def shifted(obs):
        return obs + 1

    game = make_game("toy-pursuit", num_envs=64, options={"max_steps": 3})
    plain, _, _ = play_spied(game, PURSUER, None)
    for mode, here in (("zeros", 0.0), ("initial", 0.2)):  # the typical −.8 as it looks through the filter
        blinded, victim, _ = play_spied(game, PURSUER, mode, hooks=hooks_with(shifted))
        assert blinded.seen("own")[:, :, 2] == pytest.approx(here, abs=0.05)
        assert (blinded.seen("own")[:, :, OWN] == plain.seen("own")[:, :, OWN] + 1).all()
        assert (victim.seen("own") == plain.seen("opponent") + 1).all()


def test_the_victim_can_be_blinded_instead():
    game = make_game("toy-pursuit", num_envs=64, options={"max_steps": 3})
    plain, seeing, _ = play_spied(game, PURSUER, None)
    adversary, blinded, _ = play_spied(game, PURSUER, "zeros", blind_side=1 - PURSUER)
    assert (blinded.seen("own")[:, :, 2:4] == 0).all()
    assert (blinded.seen("own")[:, :, OWN] == seeing.seen("own")[:, :, OWN]).all()
    # the adversary, and what its methods read of the victim, are as before
    assert (adversary.seen("own") == plain.seen("own")).all()
    assert (adversary.seen("opponent") == plain.seen("opponent")).all()


def test_a_filter_that_draws_draws_the_same_when_blinding_looks_at_starts():
    def noisy(context, obs):
        return obs + torch.randn(obs.shape, generator=context.generator)

    game = make_game("toy-pursuit", num_envs=4, options={"max_steps": 3})
    open_eyes, blinded = (
        play_spied(game, PURSUER, mode, hooks=hooks_with(noisy))[0] for mode in (None, "initial")
    )
    assert (open_eyes.seen("own")[:, :, OWN] == blinded.seen("own")[:, :, OWN]).all()
    assert (open_eyes.seen("opponent") == blinded.seen("opponent")).all()


class Witness(Method):
    """Looks at what methods are shown in evaluations; adds nothing."""

    views: list[View] = []

    @hookimpl
    def extend_observation(self, context, view):
        if context.mode == "eval":
            Witness.views.append(
                View(view.own.clone(), view.opponent.clone(), view.first, view.opponent_action)
            )
        return None


@pytest.fixture(scope="module")
def plugins():
    return registry_with(Witness, name="witness", requires=("apil",))


@pytest.fixture(scope="module")
def trained(tmp_path_factory, plugins):
    path = tmp_path_factory.mktemp("runs") / "r"
    run(small_config("witness"), out=path, plugins=plugins)
    return path


def shown(trained, plugins, **options):
    """What methods saw of one evaluation: own, opponent, opponent's action, each (rows, k); and the score."""
    Witness.views = []
    result = evaluate(trained, episodes=40, plugins=plugins, **options)
    parts = ("own", "opponent", "opponent_action")
    return *(torch.cat([getattr(v, part) for v in Witness.views]) for part in parts), result


def varies(values):
    return bool((values != values[0]).any())


@pytest.mark.parametrize("mode", ["zeros", "initial"])
def test_methods_get_the_blinded_view_and_a_true_opponent_unless_asked(trained, plugins, mode):
    own, opponent, action, result = shown(trained, plugins, blind=mode)
    assert (result.blind, result.blind_imitator) == (mode, False)
    assert not varies(own[:, OPPONENT])
    assert all(varies(own[:, column]) for column in OWN)
    assert all(varies(part[:, 0]) for part in (opponent, action))
    assert bool(own[:, 2].any()) == (mode == "initial")

    own, opponent, action, result = shown(trained, plugins, blind=mode, blind_imitator=True)
    assert (result.blind, result.blind_imitator) == (mode, True)
    assert not varies(own[:, OPPONENT])
    assert not varies(opponent)
    assert bool(opponent.any()) == (mode == "initial")
    assert not action.any()


def imitator_inputs(monkeypatch, trained, plugins, **options):
    rows = []
    forward = Imitator.forward

    def noted(self, states):
        rows.append(states.clone())
        return forward(self, states)

    monkeypatch.setattr(Imitator, "forward", noted)
    result = evaluate(trained, episodes=20, plugins=plugins, **options)
    monkeypatch.undo()
    return torch.cat(rows), result


def test_the_imitator_reads_the_victim_until_it_is_blinded_too(monkeypatch, trained, plugins):
    inputs, result = imitator_inputs(monkeypatch, trained, plugins)
    assert (result.blind, result.blind_imitator) == (None, False)
    assert varies(inputs[:, 0])
    inputs, _ = imitator_inputs(monkeypatch, trained, plugins, blind="zeros")
    assert varies(inputs[:, 0])
    for mode in ("zeros", "initial"):
        inputs, _ = imitator_inputs(monkeypatch, trained, plugins, blind=mode, blind_imitator=True)
        assert not varies(inputs)


def outcome(result):
    return (result.wins, result.ties, result.losses, result.mean_length)


def test_a_blinded_score_is_another_and_reproducible(trained, plugins):
    seeing, blinded, again = (
        outcome(evaluate(trained, episodes=60, plugins=plugins, blind=mode, threads=threads))
        for mode, threads in ((None, 1), ("initial", 1), ("initial", 2))
    )
    assert blinded == again
    assert blinded != seeing


def test_a_named_policy_can_be_blinded():
    adversary = "baseline:random/7x2"
    plain, blinded = (
        evaluate(adversary, env="toy-pursuit", episodes=20, blind=mode, blind_imitator=mode is not None)
        for mode in (None, "initial")
    )
    assert blinded.blind == "initial"
    assert outcome(blinded) == outcome(plain), "it looks at nothing, and the games are the same"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"blind_imitator": True}, "--blind-imitator needs --blind zeros or --blind initial"),
        ({"blind": "zero"}, "blind: should be 'zeros' or 'initial', got 'zero' (did you mean 'zeros'?)"),
    ],
)
def test_mistakes(options, message):
    with pytest.raises(ApilError, match=re.escape(message)):
        evaluate("no-such-run", **options)


def test_a_game_must_say_which_channels():
    def mute(num_envs, threads, options):
        game = make_game("toy-pursuit", num_envs=num_envs)
        sides = tuple(replace(side, opponent_channels=()) for side in game.layout.sides)
        game.layout = replace(game.layout, sides=sides)
        return game

    registry = registry_with(Method, name="mute", requires=())
    sys.modules["plugin_mute"].mute = mute
    victim = "scripted:toy-pursuit/evader/v1"
    registry.games["mute"] = GameSpec("mute", "plugin_mute:mute", default_victim=victim)
    with pytest.raises(ApilError, match="cannot blind the pursuer: game 'mute' does not say which") as caught:
        evaluate("baseline:random/7x2", env="mute", plugins=registry, blind="zeros", episodes=2)
    assert "\n" not in str(caught.value)
