"""Cross-play: which scores there are, that none is played twice, what is refused before the first game."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.small_runs import small_config

from apil_core import ApilError, ConfigError, RunDirError, evaluate
from apil_core.api.profiles import Profile
from apil_core.common.statistics import difference
from apil_core.evaluation.crossplay.crossplay import crossplay
from apil_core.evaluation.crossplay.document import CrossPlay, comparisons
from apil_core.evaluation.crossplay.heat_map import draw_crossplay
from apil_core.evaluation.crossplay.players import check_unchanged, load_all
from apil_core.evaluation.options import PairingOptions
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.runs.labels import labelled
from apil_core.runs.runner import run

EVADER = "scripted:toy-pursuit/evader/v1"
ADVERSARIES = {"noise": "random", "still": "zero"}
VICTIMS = {"original": "auto", "noise": "random"}
SMALL: dict[str, Any] = {"env": "toy-pursuit", "episodes": 20, "threads": 1}


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "r"
    run(small_config("adrl", steps=1024, seed=3), out=path)
    return path


@pytest.fixture(scope="module")
def played() -> CrossPlay:
    return crossplay(ADVERSARIES, VICTIMS, **{**SMALL, "episodes": 60})


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("kept") / "x.json"
    crossplay(ADVERSARIES, {"original": "auto"}, **SMALL, out=path)
    return path.read_bytes()


def counts(score: EvaluationResult | None) -> tuple[object, ...]:
    assert score is not None
    return score.wins, score.ties, score.losses, score.causes, score.mean_length


class Watching(Progress):
    def __init__(self, stop_after: int | None = None):
        self.notes: list[str] = []
        self.games: list[tuple[int, int]] = []
        self.stop_after = stop_after

    def evaluation_progress(self, done: int, total: int) -> None:
        self.games.append((done, total))

    def note(self, text: str) -> None:
        self.notes.append(text)
        if len(self.notes) == self.stop_after:
            raise KeyboardInterrupt


# --- scores


def test_every_cell_is_what_eval_says(trained: Path, tmp_path: Path) -> None:
    watching = Watching()
    rows = {"adrl": trained, "noise": "random"}
    found = crossplay(rows, VICTIMS, **SMALL, seed=2, out=tmp_path / "x.json", progress=watching)
    for i, name in enumerate(rows.values()):
        for j, victim in enumerate(VICTIMS.values()):
            again = evaluate(name, env="toy-pursuit", victim=victim, episodes=20, seed=2, threads=1)
            assert counts(found.scores[i][j]) == counts(again)
    assert [player.label for player in found.adversaries] == ["adrl", "noise"]
    assert [(player.method, player.seed) for player in found.adversaries] == [("adrl", 3), (None, None)]
    assert found.victims[0].name == EVADER
    assert len({score.adversary.sha256 for score in found.played}) == 2
    assert watching.games[-1] == (80, 80)
    assert watching.games == sorted(watching.games)
    assert watching.notes[-1].startswith("4 of 4 pairings: noise against noise: win ")
    assert CrossPlay.read(tmp_path / "x.json") == found


def test_a_label_finds_its_cell(played: CrossPlay) -> None:
    assert played.score("still", "original") == played.scores[1][0]
    assert played.score("still", "nobody") is None
    assert played.complete


def test_comparisons_are_with_the_first_row_and_column(played: CrossPlay) -> None:
    found = played
    compared = {
        (c.share, c.adversary, c.victim, c.base_adversary, c.base_victim): c for c in comparisons(found)
    }
    assert len(compared) == 2 * 4  # for each share: one below, one beside, and both for the last cell
    one = compared["win_or_tie", "still", "original", "noise", "original"].difference
    score, base = found.scores[1][0], found.scores[0][0]
    assert score is not None
    assert base is not None
    assert one == difference(score.wins + score.ties, 60, base.wins + base.ties, 60)
    beside = compared["win_or_tie", "noise", "noise", "noise", "original"].difference
    assert not beside.within_noise  # games of two who do not move on purpose are all ties
    assert compared["win", "still", "noise", "noise", "noise"].difference.within_noise


# --- keeping and continuing


def test_an_interrupted_one_is_continued(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    with pytest.raises(KeyboardInterrupt):
        crossplay(ADVERSARIES, VICTIMS, **SMALL, out=path, progress=Watching(stop_after=2))
    half = CrossPlay.read(path)
    assert [[score is not None for score in row] for row in half.scores] == [[True, True], [False, False]]
    watching = Watching()
    whole = crossplay(ADVERSARIES, VICTIMS, **SMALL, out=path, progress=watching)
    assert len(watching.notes) == 2
    assert watching.games[-1] == (40, 40)
    assert whole.scores[0] == half.scores[0]  # wall-clock time and all: not played again
    fresh = crossplay(ADVERSARIES, VICTIMS, **SMALL)
    assert [[counts(s) for s in row] for row in whole.scores] == [
        [counts(s) for s in row] for row in fresh.scores
    ]


@pytest.mark.slow
def test_players_may_join_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    first = crossplay({"still": "zero"}, {"original": "auto"}, **SMALL, out=path)
    grown = crossplay(ADVERSARIES, VICTIMS, **SMALL, out=path)
    assert grown.score("still", "original") == first.scores[0][0]
    assert grown.complete
    assert grown.created == first.created
    before = path.read_bytes()
    assert crossplay(ADVERSARIES, VICTIMS, **SMALL, out=path, progress=Watching(1)) == grown
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("rows", "change", "message"),
    [
        (ADVERSARIES, {"seed": 1}, "games were played with seed 0, this call has 1"),
        (ADVERSARIES, {"episodes": 10}, "episodes 20, this call has 10"),
        (ADVERSARIES, {"num_envs": 4}, "num_envs 20, this call has 4"),
        (ADVERSARIES, {"sets": ["game.max_steps=9"]}, "game.max_steps 50, this call has 9"),
        (ADVERSARIES, {"victim_actions": "mode"}, "victim_actions sample, this call has mode"),
        ({"noise": "zero", "still": "random"}, {}, "adversary noise was SHA-256 "),
        ({"noise": "random"}, {}, "holds games of adversary still, whom this call does not name"),
    ],
    ids=str,
)
def test_a_file_of_other_games_or_players_is_refused(
    kept: bytes, tmp_path: Path, rows: dict[str, str], change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(kept)
    with pytest.raises(ConfigError, match="--out file") as caught:
        crossplay(rows, {"original": "auto"}, **{**SMALL, **change}, out=path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == kept


def test_a_damaged_file_and_a_wrong_place_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text("{}")
    for out, message in (
        (path, "this is no document of apil crossplay"),
        (tmp_path, "is a directory"),
        (tmp_path / "no" / "x.json", "its directory does not exist"),
    ):
        with pytest.raises(ConfigError, match=message):
            crossplay(ADVERSARIES, VICTIMS, **SMALL, out=out)


def test_a_document_must_be_a_whole_table(kept: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    data = json.loads(kept)
    data["scores"].pop()
    path.write_text(json.dumps(data))
    with pytest.raises(ConfigError, match="no document"):
        CrossPlay.read(path)


# --- before the first game


@pytest.mark.parametrize(
    ("rows", "columns", "change", "message"),
    [
        ({"a": "random", "b": "nonsense:x"}, VICTIMS, {}, "unknown policy 'nonsense:x'"),
        (ADVERSARIES, {"a": "auto", "b": "baseline:random/9x9"}, {}, "takes 9 observations"),
        (ADVERSARIES, VICTIMS, {"env": None}, "say which game random plays"),
        (ADVERSARIES, VICTIMS, {"episodes": 0}, "episodes must be at least 1, got 0"),
        (ADVERSARIES, VICTIMS, {"num_envs": 0}, "num_envs must be at least 1, got 0"),
        ({}, VICTIMS, {}, "name at least one adversary"),
        (ADVERSARIES, {}, {}, "name at least one victim"),
    ],
    ids=str,
)
def test_mistakes_are_found_before_the_first_game(
    rows: dict[str, str], columns: dict[str, str], change: dict[str, Any], message: str
) -> None:
    watching = Watching()
    with pytest.raises(ApilError, match=message) as caught:
        crossplay(rows, columns, **{**SMALL, **change}, progress=watching)
    assert "\n" not in str(caught.value)
    assert watching.games == []


def test_runs_must_agree_on_the_game(trained: Path, tmp_path: Path) -> None:
    other = tmp_path / "r"
    run(small_config("adrl", steps=512, game={"max_steps": 30}), out=other)
    rows = {"short": other, "adrl": trained}
    with pytest.raises(ConfigError, match="short has game.max_steps 30, adrl has 50; say which with --set"):
        crossplay(rows, VICTIMS, **SMALL)
    found = crossplay(rows, VICTIMS, **SMALL, sets=["game.max_steps=20"])
    assert {score.options_played["max_steps"] for score in found.played} == {20}


def test_policies_that_no_run_trained_play_in_the_runs_game(tmp_path: Path) -> None:
    path = tmp_path / "r"
    changed = {"game": {"max_steps": 30}, "evaluation": {"adversary_actions": "mode"}}
    run(small_config("adrl", steps=512, **changed), out=path)
    rows = {"noise": "random", "adrl": path}  # whatever the order
    found = crossplay(rows, {"original": "auto"}, **SMALL)
    assert {score.options_played["max_steps"] for score in found.played} == {30}
    assert {score.adversary_actions for score in found.played} == {"mode"}
    asked = crossplay(rows, {"original": "auto"}, **SMALL, adversary_actions="sample")
    assert {score.adversary_actions for score in asked.played} == {"sample"}


@pytest.mark.parametrize("physics", ["fast", "faithful"])
def test_physics_of_a_run_are_those_of_all(physics: str, tmp_path: Path) -> None:
    path, game = tmp_path / "r", {"physics": physics, "max_steps": 40}
    run(small_config("adrl", env="kick-and-defend", num_envs=2, steps=256, game=game), out=path)
    options = PairingOptions(num_envs=1, threads=1)
    baseline = {"baseline": "embedded:kick-and-defend/defender/v1", "noise": "random", "adrl": path}
    found = load_all(baseline, {"victim": "auto"}, options)
    assert (found.setting.physics, found.setting.game_options["max_steps"]) == (physics, 40)
    other: Profile = "fast" if physics == "faithful" else "faithful"
    found = load_all(baseline, {"victim": "auto"}, PairingOptions.of(options, physics=other))
    assert found.setting.physics == other


def test_a_run_that_goes_on_meanwhile_is_noticed(played: CrossPlay) -> None:
    check_unchanged(played.adversaries[0], played.adversaries[0].sha256)
    with pytest.raises(RunDirError, match="noise has changed since it was checked"):
        check_unchanged(played.adversaries[0], "0" * 64)


# --- labels and picture


def test_labels_tell_runs_apart(trained: Path, tmp_path: Path) -> None:
    assert list(labelled([str(trained), "random"], None, None, side="adversary")) == ["adrl", "random"]
    second = tmp_path / "second"
    run(small_config("adrl", steps=512, seed=4), out=second)
    both = [str(trained), str(second)]
    assert list(labelled(both, None, None, side="adversary")) == ["adrl/s3", "adrl/s4"]
    twice = [str(trained), f"run:{trained}"]
    with pytest.raises(ConfigError, match="two players are called 'adrl/r'"):
        labelled(twice, None, None, side="adversary")
    assert list(labelled(twice, ["a", "b"], None, side="adversary")) == ["a", "b"]
    with pytest.raises(ConfigError, match="1 labels for 2 names"):
        labelled(twice, ["a"], None, side="adversary")


def test_the_games_own_policies_are_called_by_their_part() -> None:
    keeper, kicker = "zoo:kick-and-defend/defender/v1", "zoo:kick-and-defend/kicker/v1"
    assert list(labelled([keeper, "zero"], None, "kick-and-defend", side="adversary")) == ["baseline", "zero"]
    assert list(labelled([kicker], None, "kick-and-defend", side="victim")) == ["original"]
    assert list(labelled(["auto"], None, None, side="victim")) == ["original"]


def test_a_picture_says_every_share(played: CrossPlay, tmp_path: Path) -> None:
    found = played.model_copy(deep=True)
    found.adversaries[1].label = "[x]"
    found.scores[1][1] = None  # interrupted
    draw_crossplay(found, tmp_path / "map.svg")
    text = (tmp_path / "map.svg").read_text()
    assert all(label in text for label in ("noise", "[x]", "original", "toy-pursuit"))
    score = found.scores[0][0]
    assert score is not None
    assert f">{100 * score.win_rate.value:.1f}<" in text
