"""Activations: whole games recorded, sampled evenly, and how usual they are, against arithmetic by hand."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from helpers.small_runs import small_config
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import multivariate_normal, t

from apil_core import ApilError, ConfigError, Decision, Policy, PolicyInfo, VictimError, View, evaluate
from apil_core.common.charts import NORMAL
from apil_core.evaluation.pairing import load_pairing
from apil_core.evaluation.progress import Progress
from apil_core.runs.runner import run
from apil_core.studies.activations.analysis import analyze
from apil_core.studies.activations.density import check_density, fit_density
from apil_core.studies.activations.embedding import embed, usable_perplexity
from apil_core.studies.activations.intervals import gap, mean_interval
from apil_core.studies.activations.models import ActivationMap
from apil_core.studies.activations.options import Sampling
from apil_core.studies.activations.picture import draw_activations, draw_map
from apil_core.studies.activations.recording import RecordingPolicy, even_sample, game_means, record

SMALL = Sampling(games=6, steps=20, points=24, perplexity=5, components=2)
TOY: dict[str, Any] = {"env": "toy-pursuit", "threads": 1}


# --- recording


class Clock(Policy):
    """Tells which slot it acts for, and how old that slot's game is, in a tensor it uses again."""

    def __init__(self) -> None:
        self.info = PolicyInfo("clock", "", 7, 2)
        self.age = torch.zeros(0)
        self.hidden = torch.zeros(0, 2)

    def act(self, view: View, **_: Any) -> Decision:
        n = len(view.own)
        if len(self.age) != n:
            self.age, self.hidden = torch.zeros(n), torch.zeros(n, 2)
        self.age[view.first] = 0
        self.hidden[:, 0], self.hidden[:, 1] = self.age, torch.arange(n)
        self.age += 1
        return Decision(torch.zeros(n, 2), None, {"hidden": self.hidden})


@pytest.mark.parametrize(("slots", "games"), [(4, 11), (8, 8), (9, 5)])
def test_rows_are_the_steps_of_the_games_and_nothing_else(slots: int, games: int) -> None:
    with load_pairing("random", num_envs=slots, victim="random", **TOY) as pairing:
        pairing.victim = Clock()
        found = record(pairing, games, 0, Progress())
    expected = evaluate("random", victim="zero", episodes=games, num_envs=slots, victim_actions="mode", **TOY)
    assert sorted(set(found.game)) == list(range(games))
    lengths = np.bincount(found.game)
    assert lengths.mean() == pytest.approx(expected.mean_length)
    for number in range(games):
        age, slot = found.hidden[found.game == number].T
        assert age.tolist() == list(range(lengths[number]))
        assert len(set(slot)) == 1  # one game, one slot


def test_recording_changes_no_game() -> None:
    with load_pairing("random", num_envs=8, seed=3, **TOY) as pairing:
        found = record(pairing, 20, 3, Progress())
    plain = evaluate("random", episodes=20, num_envs=8, seed=3, **TOY)
    assert len(found.game) == plain.mean_length * 20
    assert np.linalg.norm(found.hidden, axis=1) == pytest.approx(1, abs=1e-5)  # the evader's unit vector


def test_a_black_box_is_one_line() -> None:
    with pytest.raises(VictimError, match="zero/7x2 is a black box") as caught:
        analyze({}, victim="zero", baseline="random", sampling=SMALL, **TOY)
    assert "\n" not in str(caught.value)
    view = View(torch.zeros(1, 7), torch.zeros(1, 7), torch.ones(1, dtype=torch.bool))
    with load_pairing("random", num_envs=1, victim="zero", **TOY) as pairing, pytest.raises(VictimError):
        RecordingPolicy(pairing.victim, 1).act(view, sample=False)


# --- sampling


def test_every_game_gives_as_many_steps() -> None:
    game = np.array([2, 0, 0, 1, 0, 2, 0, 2, 0])
    rows = even_sample(game, 2, seed=0)
    assert rows.tolist() == sorted(set(rows.tolist()))
    assert np.bincount(game[rows]).tolist() == [2, 1, 2]
    drawn = np.array([even_sample(game, 2, seed) for seed in range(2000)])
    share = np.bincount(drawn.ravel(), minlength=9) / 2000
    assert share[game == 0] == pytest.approx(2 / 5, abs=0.05)
    assert share[game == 2] == pytest.approx(2 / 3, abs=0.05)
    assert even_sample(game, 99, 0).tolist() == list(range(9))


def test_a_long_game_counts_as_much_as_a_short_one() -> None:
    assert game_means(np.array([1.0, 5.0, 3.0, 10.0]), np.array([4, 4, 4, 7])).tolist() == [3, 10]


# --- density


def test_one_component_is_the_normal_distribution() -> None:
    random = np.random.default_rng(0)
    hidden = (random.normal(size=(4000, 2)) @ np.array([[1.0, 0.4], [0.0, 0.8]]) + [3, -1]).astype(np.float32)
    density = fit_density(hidden, components=1, variance=0.9999)
    exact = multivariate_normal(hidden.mean(0), np.cov(hidden.T, bias=True)).logpdf(hidden[:50])
    assert density.log_likelihood(hidden[:50]) == pytest.approx(exact, abs=0.02)  # but for the floor
    assert density.explained(hidden) == pytest.approx(1)


def test_bic_finds_the_clusters_and_stops() -> None:
    random = np.random.default_rng(1)
    centres = np.array([[0, 0], [6, 0], [0, 6]])
    hidden = (centres[random.integers(3, size=900)] + random.normal(size=(900, 2))).astype(np.float32)
    density = fit_density(hidden, candidates=(1, 2, 3, 4, 5, 6))
    assert density.mixture.n_components == 3
    assert list(density.bic) == [1, 2, 3, 4]
    far = density.log_likelihood(np.array([[30, 30]], np.float32))
    assert far < density.log_likelihood(centres.astype(np.float32)).min() - 50


def test_directions_that_hardly_vary_are_left_out_and_said_so() -> None:
    random = np.random.default_rng(2)
    hidden = random.normal(size=(500, 3)).astype(np.float32) * np.array([1, 1, 0.01], np.float32)
    density = fit_density(hidden, components=1)
    assert density.axes.n_components_ == 2
    moved = np.tile(hidden.mean(0), (4, 1)) + np.array([0, 0, 5], np.float32)
    assert density.explained(moved) < 0.01  # normal play never went there: the density does not see it


def test_activations_on_a_line_have_a_finite_density() -> None:
    line = np.linspace(0, 1, 50, dtype=np.float32)[:, None] * np.ones((1, 3), np.float32)
    density = fit_density(line, components=2)
    off = density.log_likelihood(line + np.float32(0.01))
    assert np.isfinite(off).all()
    with pytest.raises(VictimError, match="never change"):
        fit_density(np.ones((9, 3), np.float32))


# --- intervals


def test_the_interval_is_over_games() -> None:
    games = np.random.default_rng(3).normal(size=60)
    low, high = mean_interval(games, 0)
    half = t.ppf(0.975, 59) * games.std(ddof=1) / np.sqrt(60)
    assert (games.mean() - low, high - games.mean()) == pytest.approx((half, half), rel=0.15)
    assert mean_interval(np.full(5, 2.0), 0) == (2.0, 2.0)
    assert mean_interval(games, 1) != (low, high)


def test_a_gap_of_two_means_by_welch() -> None:
    random = np.random.default_rng(4)
    games, base = random.normal(1, 1, 50), random.normal(0, 2, 80)
    found = gap(games, base, 0)
    half = 1.98 * np.sqrt(games.var(ddof=1) / 50 + base.var(ddof=1) / 80)
    assert found.value == pytest.approx(games.mean() - base.mean())
    assert (found.high - found.low) / 2 == pytest.approx(half, rel=0.15)
    assert not found.within_noise
    assert gap(base[:40], base[40:], 0).within_noise


# --- t-SNE


def test_clouds_far_apart_stay_apart() -> None:
    random = np.random.default_rng(5)
    clouds = [random.normal(centre, 0.1, (30, 4)).astype(np.float32) for centre in (0, 5)]
    left, right = map(np.array, embed(clouds, 5, 0))
    spread = max(left.std(0).max(), right.std(0).max())
    assert np.linalg.norm(left.mean(0) - right.mean(0)) > 3 * spread
    assert (usable_perplexity(50, 301), usable_perplexity(50, 31)) == (50, 10)


# --- all together


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "r"
    run(small_config("adrl", steps=512), out=path)
    return path


@pytest.fixture(scope="module")
def found(trained: Path) -> ActivationMap:
    return analyze({"adrl": trained}, baseline="zero", sampling=SMALL, threads=1)


def test_the_document_says_what_was_looked_at(found: ActivationMap, tmp_path: Path) -> None:
    assert found.opponents == ["baseline", "adrl"]
    assert [player.method for player in found.players] == [None, "adrl"]
    assert (found.env, found.victim) == ("toy-pursuit", "scripted:toy-pursuit/evader/v1")
    assert (found.layer, found.units, found.components, found.dimensions) == ("hidden", 2, 2, 2)
    assert [len(points) for points in found.points] == [24, 24]
    assert [each.n for each in found.log_likelihood] == [6, 6]
    baseline, adrl = found.log_likelihood
    assert baseline.low <= baseline.mean <= baseline.high
    assert baseline.to_baseline is None
    assert adrl.to_baseline is not None
    assert adrl.to_baseline.value == pytest.approx(adrl.mean - baseline.mean)
    found.write(tmp_path / "map.json")
    assert ActivationMap.read(tmp_path / "map.json") == found


def test_normal_play_is_scored_on_games_it_was_not_fitted_on() -> None:
    with load_pairing("zero", num_envs=6, **TOY) as pairing:
        both = record(pairing, 12, 0, Progress())
    fit, held_out = both.split(6)
    assert set(fit.game) == set(range(6))
    assert set(held_out.game) == set(range(6, 12))
    density = fit_density(fit.sample(20, 0).hidden, components=2)
    drawn = held_out.sample(20, 0)
    expected = game_means(density.log_likelihood(drawn.hidden), drawn.game).mean()
    made = analyze({}, baseline="zero", sampling=SMALL, **TOY)
    assert made.log_likelihood[0].mean == pytest.approx(expected)
    assert made.fitted == pytest.approx(density.fitted)


def test_a_seed_fixes_everything(found: ActivationMap, trained: Path) -> None:
    opponents: dict[str, Path | str] = {"adrl": trained, "baseline": "zero"}
    again = analyze(opponents, sampling=SMALL, threads=2)
    same = {"created"}
    assert again.model_dump(exclude=same) == found.model_dump(exclude=same)


def test_a_picture_names_every_opponent(found: ActivationMap, tmp_path: Path) -> None:
    draw_activations(found, tmp_path / "map.svg", methods=["apl", "adrl"])
    text = (tmp_path / "map.svg").read_text()
    assert all(word in text for word in ("baseline", "adrl", "toy-pursuit"))
    assert "#d55e00" in text  # the second of two methods, in this picture as in any other
    assert "#0072b2" not in text


def test_every_point_is_on_the_picture(found: ActivationMap) -> None:
    points = [(float(x), float(y)) for x in range(20) for y in range(20)]
    figure = Figure(figsize=(5, 5))
    axis = figure.subplots()
    draw_map(axis, found.model_copy(update={"opponents": ["baseline"], "points": [points]}), [NORMAL])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[::-1, :, 0]  # rows from the bottom, as matplotlib's y
    columns, rows = axis.transData.transform(points).astype(int).T
    assert (image[rows, columns] < 200).all()


@pytest.mark.parametrize(
    ("opponents", "options", "message"),
    [
        ({}, {}, "toy-pursuit has no baseline adversary of its own: name one with --baseline"),
        ({"baseline": "zero"}, {"baseline": "random"}, "name its opponent once"),
        ({"a": "nonsense:x"}, {"baseline": "zero"}, "unknown policy 'nonsense:x'"),
        ({}, {"env": None}, "say which game they play: --env GAME"),
        ({}, {"sampling": Sampling(games=2, steps=2, components=5)}, "5 components need more than 4 samples"),
        ({}, {"num_envs": 0}, "num_envs must be at least 1, got 0"),
    ],
    ids=str,
)
def test_mistakes_are_found_before_the_first_game(
    opponents: dict[str, str], options: dict[str, Any], message: str
) -> None:
    class Silent(Progress):
        def evaluation_progress(self, done: int, total: int) -> None:
            raise AssertionError("a game was played")

    with pytest.raises(ApilError, match=message) as caught:
        analyze(opponents, progress=Silent(), **{**TOY, **options})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"games": 1}, "games must be at least 2, got 1"),
        ({"perplexity": 0.5}, "perplexity must be at least 1, got 0.5"),
        ({"perplexity": float("nan")}, "perplexity must be at least 1, got nan"),
        ({"game": 3}, "game: unknown key (did you mean 'games'?)"),
    ],
)
def test_numbers_of_the_sampling_are_checked(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Sampling(**wrong)
    assert str(caught.value) == message


def test_the_victim_is_the_one_that_all_runs_attack(trained: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    run(small_config("adrl", steps=512, victim="random"), out=other)
    with pytest.raises(ApilError, match="runs attack different victims .*say whose with --victim"):
        analyze({"a": trained, "b": other}, baseline="zero", sampling=SMALL, threads=1)
    config = trained.with_name("changed")
    shutil.copytree(trained, config)
    text = (config / "config.yaml").read_text()
    pinned = next(line for line in text.splitlines() if line.startswith("victim_sha256: "))
    (config / "config.yaml").write_text(text.replace(pinned, f"victim_sha256: {'f' * 64}"))
    with pytest.raises(VictimError, match="has changed since a run began"):
        analyze({"a": config}, baseline="zero", sampling=SMALL, threads=1)


def test_numbers_of_the_density_are_checked() -> None:
    for components, variance in ((0, 0.9), (None, 0.0), (None, 1.0)):
        with pytest.raises(ApilError):
            check_density(components, variance, 100)
