"""Pictures through the views."""

from __future__ import annotations

import numpy as np
import pytest

from apil_core import ConfigError, OpponentInsideEnv, ParallelGameEnv
from apil_core.common import colours


def has(picture: np.ndarray, colour: tuple[int, int, int]) -> bool:
    return bool((picture == colour).all(2).any())


@pytest.mark.parametrize("view", [ParallelGameEnv, OpponentInsideEnv])
def test_a_view_draws_if_asked_to(view: type) -> None:
    env = view("toy-pursuit", render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (360, 640, 3)
    assert picture.dtype == np.uint8
    assert has(picture, colours.VICTIM)
    assert has(picture, colours.ADVERSARY)
    plain = view("toy-pursuit")
    plain.reset(seed=0)
    assert plain.render() is None
    with pytest.raises(ConfigError, match="'rgb_array'"):
        view("toy-pursuit", render_mode="human")


def test_the_opponent_is_blue_whichever_its_side() -> None:
    pictures = []
    for side in (0, 1):
        env = OpponentInsideEnv("toy-pursuit", "baseline:zero/7x2", side=side, render_mode="rgb_array")
        env.reset(seed=0)
        picture = env.render()
        assert picture is not None
        pictures.append(
            [np.nonzero((picture == c).all(2))[1].mean() for c in (colours.VICTIM, colours.ADVERSARY)]
        )
    (evader_red, evader_blue) = pictures[0][1], pictures[1][0]
    assert evader_red == pytest.approx(evader_blue, abs=0.5)
