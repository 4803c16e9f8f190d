"""Single games: the same whether or not they are watched, with any policy in either seat."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.small_runs import small_config

from apil_core import ApilError, ConfigError, Decision, Policy, PolicyInfo, View, run
from apil_core.common.seeds import stream_seed
from apil_core.evaluation.options import RenderOptions
from apil_core.evaluation.pairing import Pairing, load_pairing
from apil_core.evaluation.play import play
from apil_core.evaluation.video.recording import show
from apil_core.evaluation.video.single_game import Frame, SingleGames
from apil_core.training.storage.run_dir import RunDir


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("single") / "run"
    run(small_config("apil", steps=512), out=directory)
    return directory


def pairing(adversary: Path | Policy | str = "random", **options: object) -> Pairing:
    env = None if isinstance(adversary, Path) else "toy-pursuit"
    return load_pairing(adversary, num_envs=1, env=env, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("who", ["random", "run"])
def test_a_game_is_the_same_whether_or_not_it_is_watched(trained: Path, who: str) -> None:
    single = SingleGames(pairing(trained if who == "run" else who), seed=5)
    seen: list[Frame] = []
    watched = single.play(3, seen.append)
    assert [frame.step for frame in seen] == list(range(watched.steps + 1))
    assert seen[-1].ended == watched
    assert all(frame.ended is None for frame in seen[:-1])
    assert seen[-1].seconds == pytest.approx(0.05 * watched.steps)
    other = single.play(1)
    assert other.adversary_return != watched.adversary_return
    assert single.play(3) == watched
    assert SingleGames(pairing(trained if who == "run" else who), seed=5).play(3) == watched


def test_outcome_and_returns_are_the_games_own() -> None:
    ours = pairing("random")
    played = SingleGames(ours, seed=2).play(1)
    seed = stream_seed(2, "game 1")
    ours.game.seed(seed)
    tally = play(ours.game, ours.players(seed), 1)
    assert tally.lengths == [played.steps]
    assert ours.game.layout.causes[tally.causes[0]] == played.cause
    assert {1: "win", -1: "tie", 0: "loss"}[tally.winners[0]] == played.outcome
    sparse = {"win": 1000, "loss": -1000, "tie": -1000}[played.outcome]  # a quick catch would earn 500 more
    assert abs(played.adversary_return - sparse) < 200
    assert played.adversary_return == pytest.approx(-played.victim_return) or played.outcome == "tie"


def test_find_gives_the_first_that_ends_so() -> None:
    # about the time the evader needs to its gate
    single = SingleGames(pairing("random", sets=["game.max_steps=40"]), seed=0)
    outcomes = [single.play(number).outcome for number in range(1, 13)]
    assert len(set(outcomes)) > 1, outcomes
    for outcome in set(outcomes):
        found = single.find(outcome, 12)
        assert found is not None
        assert found.number == outcomes.index(outcome) + 1
    assert single.find(outcomes[-1], 0) is None


def test_short_names_take_the_seats_sizes() -> None:
    ours = pairing("zero", victim="random")
    assert ours.adversary.info.name == "baseline:zero/7x2"
    assert ours.victim.info.name == "baseline:random/7x2"


def test_a_run_can_sit_in_the_seat_it_trained(trained: Path, tmp_path: Path) -> None:
    other = tmp_path / "evader"
    run(small_config("adrl", steps=512, victim="baseline:random/7x2", victim_side=1), out=other)
    ours = pairing(trained, victim=str(other))
    assert ours.victim.info.name == f"run:{RunDir(other).newest_checkpoint()}"
    assert SingleGames(ours, seed=0).play(1).steps > 0
    with pytest.raises(ConfigError, match=r"trained the pursuer of toy-pursuit; it cannot be the evader"):
        pairing("random", victim=str(trained))


def test_a_policy_that_does_not_repeat_itself_is_noticed(tmp_path: Path) -> None:
    ours = pairing("random")
    act = ours.adversary.act

    def restless(*arguments: object, generator: torch.Generator, **options: object) -> object:
        return act(*arguments, generator=torch.Generator().manual_seed(next(seeds)), **options)  # type: ignore

    seeds = iter(np.random.default_rng(0).integers(0, 10**9, 10_000).tolist())
    ours.adversary.act = restless  # type: ignore[method-assign]
    options = RenderOptions(snapshots=2, contact_sheet=tmp_path / "sheet.png", width=40, height=30)
    with pytest.raises(ApilError, match="went another way when played again"):
        show(ours, options)
    assert not list(tmp_path.iterdir())


class OwnDraws(Policy):
    """Moves at random, from a generator of its own."""

    def __init__(self) -> None:
        self.info = PolicyInfo("own draws", "", 7, 2)
        self.generator = torch.Generator()

    def seed(self, seed: int) -> None:
        self.generator.manual_seed(seed)

    def act(self, view: View, **_: object) -> Decision:
        return Decision(torch.randn(len(view.own), 2, generator=self.generator))


def test_a_policys_own_draws_are_repeated() -> None:
    single = SingleGames(pairing(OwnDraws()), seed=0)
    first, second = single.play(1), single.play(2)
    assert (single.play(1), single.play(2)) == (first, second)
    assert first != second
