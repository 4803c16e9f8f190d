"""From a matrix to its cells: what is combined, what cells are called, which mistakes are told."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from apil_core import ConfigError, evaluate
from apil_core.common.errors import ApilError
from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.jobs import matches
from apil_core.studies.bench.matrix import Matrix, load_matrix, matrix_names
from bench.small_matrix import small_matrix


def names(matrix: Matrix) -> list[str]:
    return [cell.name for cell in resolve_matrix(matrix).cells]


def test_every_combination_is_a_cell():
    matrix = small_matrix(methods=["adrl", "apl"], seeds="0..2", steps=["1k", "3072"])
    cells = resolve_matrix(matrix).cells
    assert len(cells) == 2 * 3 * 2
    assert {(c.method, c.seed, c.steps) for c in cells} == {
        (m, s, n) for m in ("adrl", "apl") for s in (0, 1, 2) for n in (1000, 3072)
    }
    assert all((c.config.method, c.config.seed, c.config.steps) == (c.method, c.seed, c.steps) for c in cells)
    assert all(c.config.num_envs == 32 and c.config.ppo.epochs == 2 for c in cells)


def test_names_stay_when_the_matrix_grows():
    small = names(small_matrix())
    assert small == ["toy-pursuit/adrl/s0"]
    grown = small_matrix(methods=["apl", "adrl"], seeds=[1, 0], steps=[3072, "2M"])
    assert set(small) <= set(names(grown))
    assert "toy-pursuit/apl/s1-2M" in names(grown)


def test_the_victim_is_named_even_if_nobody_named_it():
    benchmark = resolve_matrix(small_matrix())
    assert benchmark.cells[0].victim == "scripted:toy-pursuit/evader/v1"
    assert benchmark.matrix.victims == {"toy-pursuit": ("scripted:toy-pursuit/evader/v1",)}


def test_several_victims_make_cells_of_their_own():
    evader, still = "scripted:toy-pursuit/evader/v1", "baseline:zero/6x2"
    found = names(small_matrix(victims={"toy-pursuit": [evader, still]}))
    assert found == [
        "toy-pursuit/adrl/s0-scripted_toy-pursuit_evader_v1",
        "toy-pursuit/adrl/s0-baseline_zero_6x2",
    ]


def test_an_axis_sets_what_it_names():
    cells = resolve_matrix(small_matrix(axes={"ppo.epochs": [1, 3], "game.max_steps": [20]})).cells
    assert [(c.config.ppo.epochs, c.config.game["max_steps"]) for c in cells] == [(1, 20), (3, 20)]
    assert cells[1].axes == {"ppo.epochs": 3, "game.max_steps": 20}
    assert cells[1].name == "toy-pursuit/adrl/s0-ppo.epochs=3-game.max_steps=20"


def test_a_preset_of_one_game_lies_between_the_others_and_config():
    presets = {"presets": ["efficient"], "game_presets": {"sumo-ants": ["sumo-ants"]}}
    matrix = small_matrix(games=["toy-pursuit", "sumo-ants"], config={"ppo": {"lam": 0.9}}, **presets)
    toy, ants = (cell.config for cell in resolve_matrix(matrix).cells)
    assert (toy.ppo.gamma, ants.ppo.gamma, ants.ppo.lam, ants.ppo.noise) == (0.99, 0.998, 0.9, "coloured")
    assert ants.game["untouched_reward"] == -1000
    with pytest.raises(ValueError, match=r"game_presets: 'sumo-humans' is not among the matrix's games"):
        small_matrix(game_presets={"sumo-humans": ["efficient"]})


def test_an_axis_of_one_method_does_not_multiply_the_others():
    matrix = small_matrix(methods=["adrl", "apil"], axes={"options.apil.prediction": ["imitator", "noise"]})
    assert names(matrix) == [
        "toy-pursuit/adrl/s0",
        "toy-pursuit/apil/s0-apil.prediction=imitator",
        "toy-pursuit/apil/s0-apil.prediction=noise",
    ]


@pytest.fixture
def dimming(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Path of a one-file plugin with the observer ``dim`` and its option ``by``."""
    monkeypatch.delitem(sys.modules, "dimming", raising=False)
    file = tmp_path / "dimming.py"
    file.write_text(
        "from apil_core import Observer, ObserverSpec, Section, hookimpl\n"
        "class Options(Section):\n    by: float = 0.5\n"
        "class Dim(Observer):\n    @hookimpl\n"
        "    def filter_observation(self, context, obs):\n"
        "        return obs * self.options.by if context.role == 'victim' else None\n"
        "@hookimpl\ndef register_observers():\n"
        "    return [ObserverSpec('dim', f'{__name__}:Dim', config=f'{__name__}:Options')]\n"
    )
    return str(file)


def observed_matrix(file: str, **changes: Any) -> Matrix:
    base = small_matrix().config
    return small_matrix(config={**base, "plugins": [file]}, **changes)


def test_an_axis_of_an_observer_does_not_multiply_cells_without_it(dimming: str):
    axes = {"options.dim.by": [0.1, 0.9], "observers": [[], ["dim"]]}
    cells = resolve_matrix(observed_matrix(dimming, axes=axes)).cells
    assert [(c.config.observers, c.config.options.get("dim")) for c in cells] == [
        ((), None),
        (("dim",), {"by": 0.1}),
        (("dim",), {"by": 0.9}),
    ]
    assert len({c.name for c in cells}) == 3


def test_the_observers_of_a_score_are_spelt_out_and_part_of_what_is_asked_for(dimming: str):
    scores = {"plain": {"episodes": 4}, "dimmed": {"episodes": 4, "observers": {"dim": {}}}}
    benchmark = resolve_matrix(observed_matrix(dimming, scores=scores))
    found = benchmark.matrix.scores["dimmed"]
    assert found.observers == {"dim": {"by": 0.5}}
    config = benchmark.cells[0].config
    played = evaluate(
        "random", episodes=4, env=config.env, plugins=benchmark.plugins, observers=found.observers
    )
    cell = replace(benchmark.cells[0], victim=played.victim.name)
    assert matches(played, found, cell, None)
    assert not matches(played, benchmark.matrix.scores["plain"], cell, None)
    own = replace(
        cell, config=cell.config.model_copy(update={"observers": ("dim",), "options": {"dim": {"by": 0.5}}})
    )
    trained = played.model_copy(update={"trained_steps": 512})
    plain = benchmark.matrix.scores["plain"]
    assert matches(trained, plain, own, 512)  # the observer is the run's own
    assert not matches(trained, plain, cell, 512)
    assert matches(trained.model_copy(update={"observers": None}), plain, own, 512)  # from before scores told
    other = found.model_copy(update={"observers": {"dim": {"by": 0.1}}})
    assert not matches(played, other, cell, None)


@pytest.mark.parametrize(
    ("observers", "told"),
    [
        ({"dimm": {}}, "matrix: scores.dimmed: unknown observer 'dimm' (did you mean 'dim'?"),
        ({"dim": {"bye": 1}}, "matrix: scores.dimmed: observers: options.dim.bye: unknown key (did you"),
    ],
)
def test_mistakes_in_a_scores_observers_are_told_before_anything_starts(dimming: str, observers, told):
    with pytest.raises(ApilError) as error:
        resolve_matrix(observed_matrix(dimming, scores={"plain": {}, "dimmed": {"observers": observers}}))
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"methods": ["adrll"]}, "matrix: methods.0: unknown method 'adrll' (did you mean 'adrl'?"),
        ({"games": ["toy-persuit"]}, "did you mean 'toy-pursuit'?"),
        ({"config": {"ppo": {"epochz": 2}}}, "ppo.epochz: unknown key (did you mean 'epochs'?)"),
        ({"axes": {"ppo.epochs": [0]}}, "axis ppo.epochs=0: "),
        (
            {"axes": {"options.apil.prediction": ["noise"]}},
            "axes.options.apil.prediction: no method or observer here reads options",
        ),
        (
            {"config": {"options": {"apill": {}}}},
            "config.options: no method or observer here reads options of 'apill'",
        ),
        ({"axes": {"ppo.": [1]}}, "expected key=value"),
    ],
)
def test_mistakes_in_cells_are_one_line(changes, told):
    with pytest.raises(ApilError) as error:
        resolve_matrix(small_matrix(**changes))
    assert told in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"seeds": [0, 0]}, "seeds names a value twice"),
        ({"axes": {"seed": [1, 2]}}, "axes.seed: use 'seeds' for it"),
        ({"axes": {"ppo.epochs": []}}, "at least 1 item"),
        ({"scores": {"blinded": {}}}, "scores needs 'plain'"),
        ({"scores": {"plain": {"games": ["chess"]}}}, "scores.plain.games: 'chess' is not among"),
        ({"retraining": {"methods": ["apl"]}}, "retraining.methods: 'apl' is not among"),
        ({"config": {"steps": "1M"}}, "config.steps: use 'steps' for it"),
        ({"config": {"env": "sumo-ants"}}, "config.env: use 'games' for it"),
        ({"scores": {"plain": {"blind": "zeros"}}}, "scores.plain: table 1 is made of it"),
        ({"victims": {"chess": ["auto"]}}, "victims: 'chess' is not among"),
        ({"steps": "0"}, "steps must be positive"),
        ({"axes": {"game.max_steps": [9, 20]}, "crossplay": {}}, "crossplay needs one game for all"),
        ({"axes": {"observers": [[], ["dim"]]}, "crossplay": {}}, "leave out axes.observers"),
    ],
)
def test_mistakes_in_the_matrix_itself(changes, told):
    with pytest.raises(ValidationError) as error:
        small_matrix(**changes)
    assert told in str(error.value)


def test_a_file_is_told_with_its_line(tmp_path: Path):
    path = tmp_path / "mine.yaml"
    path.write_text("methods: [adrl]\ngames: [toy-pursuit]\nscorez: {}\n")
    with pytest.raises(ConfigError, match=r"mine\.yaml:3: scorez: unknown key \(did you mean 'scores'\?\)"):
        load_matrix(str(path))
    path.write_text(
        "methods: [adrl]\ngames: [toy-pursuit]\nretraining: {step: 5}\nscores: {plain: {episode: 5}}\n"
    )
    with pytest.raises(ConfigError) as error:
        load_matrix(str(path))
    assert str(error.value).splitlines() == [
        f"{path}:3: retraining.step: unknown key (did you mean 'steps'?)",
        f"{path}:4: scores.plain.episode: unknown key (did you mean 'episodes'?)",
    ]
    with pytest.raises(ConfigError, match="smok: no such file, and no matrix that ships with apil"):
        load_matrix("smok")


def test_shipped_matrices_resolve():
    sizes = {name: len(resolve_matrix(load_matrix(name), name).cells) for name in matrix_names()}
    assert sizes == {"ablation": 24, "campaign": 16, "paper": 80, "quick": 16, "smoke": 4}


def test_the_campaign_can_be_extended():
    """Nothing in it follows the budget, and what has most to show comes first."""
    cells = resolve_matrix(load_matrix("campaign")).cells
    assert [cell.method for cell in cells] == [m for m in ("e_apil", "adrl", "apl", "apil") for _ in range(4)]
    assert {cell.config.ppo.lr_schedule for cell in cells} == {"constant"}
    assert all(cell.config.reward.anneal_budget for cell in cells)


def test_a_stored_matrix_comes_back_equal(tmp_path: Path):
    bench = BenchDir(tmp_path / "b")
    matrix = resolve_matrix(load_matrix("smoke")).matrix
    bench.write_matrix(matrix)
    assert bench.matrix() == matrix
    assert [c.cell.name for c in bench.cells()] == names(matrix)
    assert {c.status for c in bench.cells()} == {"waiting"}
