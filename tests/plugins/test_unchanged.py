"""What a hook was handed is compared with copies of it."""

from __future__ import annotations

import pytest
import torch

from apil_core import DiagonalGaussian, View
from apil_core.plugins.unchanged import changed, copies


def arguments():
    own = torch.tensor([[1.0, float("nan")]])
    groups = {"prediction": torch.zeros(1, 2)}
    view = View(own, torch.zeros(1, 3), torch.tensor([True]))
    distribution = DiagonalGaussian(torch.zeros(1, 2), torch.ones(2))
    return {"run": object(), "view": view, "groups": groups, "pair": [distribution], "side": 1}


def test_paths_name_fields_keys_and_places():
    assert list(copies(arguments())) == [
        "view.own",
        "view.opponent",
        "view.first",
        "groups[prediction]",
        "pair[0].mean",
        "pair[0].std",
    ]


def test_the_run_is_not_looked_into():
    assert copies({"run": torch.zeros(3)}) == {}


def test_nothing_changed_with_nan_in_it():
    handed = arguments()
    assert changed(copies(handed), handed) == []


@pytest.mark.parametrize(
    ("change", "paths"),
    [
        (lambda a: a["view"].own.mul_(2), ["view.own"]),
        (lambda a: a["view"].own.nan_to_num_(0.0), ["view.own"]),
        (lambda a: a["view"].first.logical_not_(), ["view.first"]),
        (lambda a: setattr(a["view"], "opponent", torch.ones(1, 3)), ["view.opponent"]),
        (lambda a: setattr(a["view"], "opponent", torch.zeros(1, 3).double()), ["view.opponent"]),
        (lambda a: setattr(a["view"], "opponent", None), ["view.opponent"]),
        (lambda a: a["groups"].update(more=torch.zeros(1)), ["groups[more]"]),
        (lambda a: a["groups"].clear(), ["groups[prediction]"]),
        (lambda a: a["pair"][0].std.zero_(), ["pair[0].std"]),
        (lambda a: a["view"].own.clone().mul_(2), []),
    ],
)
def test_every_kind_of_change_is_found(change, paths):
    with torch.inference_mode():  # as in a rollout
        handed = arguments()
        before = copies(handed)
        change(handed)
        assert changed(before, handed) == paths
