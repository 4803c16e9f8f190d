"""Both physics profiles of every game: what options come to, and that the game plays by it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.every_game import GAME_NAMES
from pydantic import ValidationError

from apil_core import make_game
from apil_core.api.specs import options_model
from apil_core.config.game import spelt_out
from apil_core.evaluation.fidelity.rows import read_rows
from apil_core.plugins.registry import default_plugins
from apil_envs.game_base import MujocoGame
from apil_envs.options import PhysicsOptions, PhysicsProfile

MUJOCO_GAMES = [name for name in GAME_NAMES if name != "toy-pursuit"]
EVERY_GAME = pytest.mark.parametrize("name", MUJOCO_GAMES)
ROWS = Path(__file__).parents[2] / "docs" / "results" / "fidelity.jsonl"


def model(name: str) -> type[PhysicsOptions]:
    found = options_model(default_plugins().game(name).config or "")
    assert issubclass(found, PhysicsOptions)
    return found


def game(name: str, **options: Any) -> MujocoGame:
    made = make_game(name, num_envs=2, options=options)
    assert isinstance(made, MujocoGame)
    return made


@EVERY_GAME
def test_faithful_is_the_default_and_what_the_agents_know(name: str) -> None:
    timestep = 0.01 if name == "run-to-goal-ants" else 0.003
    options = model(name)()
    assert options.physics == "faithful"
    assert options.resolved == PhysicsProfile("PGS", "RK4", timestep, 5, refresh=False)


@EVERY_GAME
def test_both_profiles_take_the_same_time_for_a_control_step(name: str) -> None:
    profiles = model(name).profiles
    assert set(profiles) == {"faithful", "fast"}
    faithful, fast = (profiles[each].timestep * profiles[each].substeps for each in ("faithful", "fast"))
    assert fast == pytest.approx(faithful, rel=1e-12)
    assert game(name, physics="fast").seconds_per_step == pytest.approx(game(name).seconds_per_step)


@EVERY_GAME
def test_a_value_of_its_own_wins_over_the_profile(name: str) -> None:
    options = model(name)(physics="fast", solver="PGS", substeps=7)
    fast = model(name).profiles["fast"]
    assert options.resolved == PhysicsProfile("PGS", fast.integrator, fast.timestep, 7, fast.refresh)
    assert options.settings["physics"] == "custom"
    assert model(name)(refresh=True).resolved.refresh  # a value, not just anything that is true


@EVERY_GAME
def test_settings_name_the_profile_that_the_values_are_of(name: str) -> None:
    for profile, values in model(name).profiles.items():
        single = dict(vars(values))
        assert model(name)(physics=profile).settings == {"physics": profile, **single}
        assert model(name)(**single).settings == {"physics": profile, **single}
    assert game(name, physics="fast").settings == model(name)(physics="fast").settings


@EVERY_GAME
def test_the_scene_is_compiled_and_stepped_as_the_profile_says(name: str) -> None:
    solvers = {"PGS": mujoco.mjtSolver.mjSOL_PGS, "Newton": mujoco.mjtSolver.mjSOL_NEWTON}
    integrators = {
        "RK4": mujoco.mjtIntegrator.mjINT_RK4,
        "Euler": mujoco.mjtIntegrator.mjINT_EULER,
        "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
        "leapfrog": mujoco.mjtIntegrator.mjINT_EULER,
    }
    for profile, values in model(name).profiles.items():
        made = game(name, physics=profile, max_steps=3)
        opt = made.physics.model.opt
        assert (opt.solver, opt.integrator) == (solvers[values.solver], integrators[values.integrator])
        assert opt.timestep == values.timestep
        made.seed(0)
        made.reset()
        actions = tuple(np.zeros((2, side.action_size), np.float32) for side in made.layout.sides)
        step = [made.step((actions[0], actions[1])) for _ in range(3)][-1]
        assert step.done.all()
        assert all(np.isfinite(seen).all() for seen in made.observations)


def test_a_profile_is_faithful_or_fast() -> None:
    with pytest.raises(ValidationError, match="'faithful' or 'fast'"):
        PhysicsOptions(physics="quick")
    with pytest.raises(ValidationError, match="greater than 0"):
        PhysicsOptions(timestep=0)


def test_games_without_profiles_have_no_settings() -> None:
    assert make_game("toy-pursuit", num_envs=1).settings == {}


# --- what was stored before there were profiles


def test_options_stored_in_full_mean_the_faithful_profile() -> None:
    stored = {"inertia": "legacy", "solver": "PGS", "integrator": "RK4", "timestep": 0.003, "substeps": 5}
    plugins = default_plugins()
    assert spelt_out("kick-and-defend", stored, plugins) == spelt_out("kick-and-defend", {}, plugins)
    assert spelt_out("sumo-ants", {**stored, "integrator": "Euler"}, plugins)["physics"] == "custom"


def test_kept_rows_are_read_and_mean_what_they_meant() -> None:
    plugins = default_plugins()
    rows = read_rows(ROWS)
    assert rows
    for row in rows:
        now = spelt_out(row.plan.env, row.plan.options, plugins)
        then = row.result.options_played
        assert {key: now[key] for key in then} == then
        if row.plan.kind == "default":
            assert now["physics"] == "faithful"
