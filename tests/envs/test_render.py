"""Pictures of the games: they show what is, and change nothing."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from helpers.every_game import GAME_NAMES, short_game

from apil_core import ApilError, Game
from apil_envs import gl
from apil_envs.game_base import MujocoGame
from apil_envs.render import LARGEST, Painter, Scenery, Studio
from apil_envs.sumo import SumoHumans
from apil_envs.toy import ToyPursuit
from envs.opengl import need_opengl

BLUE, RED = (0, 0, 255), (255, 0, 0)
SIZE = 96, 64


def actions(game: Game, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    first, second = (
        rng.uniform(side.action_low, side.action_high, (game.num_envs, side.action_size)).astype(np.float32)
        for side in game.layout.sides
    )
    return first, second


def record(game: Game, *, drawn: bool) -> list[np.ndarray]:
    """What both sides see and get over some steps, and the state in the end."""
    game.seed(3)
    game.reset()
    rng = np.random.default_rng(4)
    seen: list[np.ndarray] = []
    for _ in range(5):
        if drawn:
            game.render(1, *SIZE, (BLUE, RED))
        step = game.step(actions(game, rng))
        seen += [*(side.copy() for side in game.observations), step.sparse, step.dense, step.winner]
    state = game.state_dict()
    return [*seen, *(state[name] for name in ("physics", "position") if name in state)]


def places(picture: np.ndarray) -> tuple[float, float]:
    """Mean column of what is blue and of what is red."""
    red, green, blue = (picture[..., i].astype(int) for i in range(3))
    masks = (blue - np.maximum(red, green) > 90, red - np.maximum(blue, green) > 90)
    assert all(mask.sum() > 5 for mask in masks), [mask.sum() for mask in masks]
    first, second = (float(np.nonzero(mask)[1].mean()) for mask in masks)
    return first, second


@pytest.mark.parametrize("name", ["kick-and-defend", "sumo-ants", "toy-pursuit"])  # a ball, a ring, no MuJoCo
def test_drawing_changes_nothing(name: str) -> None:
    need_opengl()
    plain, drawn = (short_game(name, 2) for _ in range(2))
    for a, b in zip(record(plain, drawn=False), record(drawn, drawn=True), strict=True):
        np.testing.assert_array_equal(a, b)
    drawn.close()


@pytest.mark.parametrize("name", GAME_NAMES)
def test_colours_go_with_the_sides_asked_for(name: str) -> None:
    need_opengl()
    game = short_game(name, 2)
    game.seed(0)
    game.reset()
    picture = game.render(0, *SIZE, (BLUE, RED))
    assert picture.shape == (64, 96, 3)
    assert picture.dtype == np.uint8
    blue, red = places(picture)
    swapped_blue, swapped_red = places(game.render(0, *SIZE, (RED, BLUE)))
    assert blue < red
    assert abs(swapped_blue - red) < 3
    assert abs(swapped_red - blue) < 3
    game.close()


def test_every_row_is_its_own_picture() -> None:
    need_opengl()
    game = short_game("kick-and-defend", 2)
    game.seed(0)
    game.reset()
    first, second = (game.render(row, *SIZE, (BLUE, RED)) for row in (0, 1))
    assert (first != second).any()
    np.testing.assert_array_equal(first, game.render(0, *SIZE, (BLUE, RED)))
    game.close()


def test_the_ring_is_drawn_with_the_radius_of_its_game() -> None:
    game = SumoHumans(num_envs=3)
    game.seed(0)
    game.reset()
    scenery = Scenery(game.physics, 0, (BLUE, RED))
    ring = scenery.model.geom("arena")
    radii = game.physics.expand("geom_size")[:, ring.id, 0]
    assert len(set(radii)) == 3
    for row in (2, 0, 1):
        scenery.update(row, (BLUE, RED))
        assert scenery.model.geom("arena").size[0] == radii[row]
    game.reset()
    scenery.update(0, (BLUE, RED))
    assert scenery.model.geom("arena").size[0] == radii[0]


@pytest.mark.parametrize("name", [name for name in GAME_NAMES if name != "toy-pursuit"])
@pytest.mark.parametrize("aspect", [4 / 3, 16 / 9])
def test_both_players_are_in_view(name: str, aspect: float) -> None:
    """Their roots, projected as a camera of MuJoCo does, fall inside the picture."""
    game = short_game(name, 4)
    assert isinstance(game, MujocoGame)
    game.seed(1)
    game.reset()
    scenery = Scenery(game.physics, 0, (BLUE, RED))
    for row in range(4):
        scenery.update(row, (BLUE, RED))
        scenery.aim(aspect)
        camera = scenery.camera
        elevation = np.radians(camera.elevation)
        forward = np.array([0, np.cos(elevation), np.sin(elevation)])  # azimuth 90°: along y
        up = np.array([0, -np.sin(elevation), np.cos(elevation)])
        slope = np.tan(np.radians(scenery.model.vis.global_.fovy / 2))
        for side in (0, 1):
            way = scenery.data.body(f"agent{side}/torso").xpos - (camera.lookat - camera.distance * forward)
            depth = way @ forward
            assert abs(way[0]) < depth * slope * aspect
            assert abs(way @ up) < depth * slope


def test_a_picture_too_large_is_refused() -> None:
    game = short_game("kick-and-defend", 1)
    assert isinstance(game, MujocoGame)
    for size in ((LARGEST + 1, 10), (10, 0)):
        with pytest.raises(ApilError, match=f"1 to {LARGEST} pixels"):
            Painter(Scenery(game.physics, 0, (BLUE, RED)), *size)


def test_a_closed_studio_can_be_used_again() -> None:
    need_opengl()
    game = short_game("sumo-ants", 1)
    assert isinstance(game, MujocoGame)
    game.seed(0)
    game.reset()
    studio = Studio(game.physics)
    first = studio.paint(0, *SIZE, (BLUE, RED))
    studio.close()
    studio.close()
    np.testing.assert_array_equal(first, studio.paint(0, *SIZE, (BLUE, RED)))
    studio.close()


# --- the toy, by hand


def test_the_toy_is_drawn_where_it_is() -> None:
    game = ToyPursuit(1)
    game.reset()
    game._position[:, 0] = [[-0.5, 0.0], [0.5, 0.5]]
    picture = game.render(0, 200, 200, (BLUE, RED))
    assert tuple(picture[100, 100 - 42]) == BLUE  # the disc's radius is 0.85 of half the height
    assert tuple(picture[100 - 42, 100 + 42]) == RED
    assert tuple(picture[0, 0]) == (255, 255, 255)


# --- choosing OpenGL


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    gl._first_working.cache_clear()
    yield
    gl._first_working.cache_clear()


@pytest.mark.parametrize(
    ("environment", "wanted"),
    [
        ({}, ("egl", "osmesa")),
        ({"DISPLAY": ":0"}, ("glfw", "egl", "osmesa")),
        ({"WAYLAND_DISPLAY": "wayland-0"}, ("glfw", "egl", "osmesa")),
        ({"MUJOCO_GL": "osmesa", "DISPLAY": ":0"}, ("osmesa",)),
    ],
)
def test_what_is_tried_depends_on_screen_and_user(
    fresh: None, monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], wanted: tuple[str, ...]
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert gl.wanted() == wanted


def test_the_first_that_works_is_used(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def works(backend: str) -> bool:
        asked.append(backend)
        return backend == "egl"

    holder = importlib.import_module("mujoco.rendering.classic.gl_context")
    monkeypatch.setattr(holder, "GLContext", None)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(gl, "works", works)
    monkeypatch.setattr(importlib, "import_module", lambda name: holder if "gl_context" in name else _Backend)
    gl.prepare()
    gl.prepare()
    assert asked == ["glfw", "egl"]
    assert holder.GLContext is _Backend.GLContext


class _Backend:
    GLContext = object()


def test_without_any_the_message_says_what_to_install(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl, "works", lambda backend, **_: False)
    with pytest.raises(
        ApilError, match=r"tried EGL, OSMesa; install one: `apt-get install libegl1`"
    ) as caught:
        gl.prepare()
    assert "\n" not in str(caught.value)
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(ApilError, match=r"tried OSMesa \(MUJOCO_GL=osmesa\)"):
        gl.prepare()


def test_a_backend_that_cannot_start_does_not_work() -> None:
    assert not gl.works("nonsense")


def test_no_window_without_a_screen(fresh: None) -> None:
    game = short_game("kick-and-defend", 1)
    with pytest.raises(ApilError, match="no screen"):
        game.open_window(0, (BLUE, RED))


def test_a_variable_that_keeps_opengl_from_working_is_named(
    fresh: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if not gl.works("egl"):
        pytest.skip("no EGL here")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "osmesa")
    with pytest.raises(ApilError, match="PYOPENGL_PLATFORM=osmesa keeps OpenGL from working; unset it$"):
        gl.prepare()
    assert list(tmp_path.iterdir()) == [], "MuJoCo's log of the trial is elsewhere"
