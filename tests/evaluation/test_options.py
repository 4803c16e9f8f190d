"""Options of a pairing as keywords: checked, said in one line each, and laid over others."""

from __future__ import annotations

from typing import Any

import pytest

from apil_core import ConfigError
from apil_core.evaluation.options import EvaluationOptions, PairingOptions


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"num_envs": 0}, "num_envs must be at least 1, got 0"),
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"threads": -2}, "threads must be at least 0, got -2"),
        ({"victm": "random"}, "victm: unknown key (did you mean 'victim'?)"),
        ({"physics": "fsat"}, "physics: should be 'faithful' or 'fast', got 'fsat' (did you mean 'fast'?)"),
        ({"blind_imitator": True}, "--blind-imitator needs --blind zeros or --blind initial"),
        ({"seed": -1, "num_envs": 0}, "seed must be at least 0, got -1\nnum_envs must be at least 1, got 0"),
    ],
    ids=str,
)
def test_a_mistake_is_one_line(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        EvaluationOptions(**wrong)
    assert str(caught.value) == message


def test_options_lie_over_others_as_far_as_these_have_them() -> None:
    below = EvaluationOptions(env="toy-pursuit", seed=3, episodes=7)
    found = PairingOptions.of(below, seed=4)
    assert (found.env, found.seed) == ("toy-pursuit", 4)
    assert EvaluationOptions.of(found, episodes=9).episodes == 9
