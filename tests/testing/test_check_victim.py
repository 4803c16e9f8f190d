"""check_victim: the scripted victim passes, and each check has a policy that fails it and is told so."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core.testing import ContractError, VictimReport, check_victim

BROKEN = """
import hashlib
import itertools

import torch

from apil_core import Decision, Policy, PolicyInfo, PolicySpec, hookimpl

COUNT = itertools.count()


class Broken(Policy):
    def __init__(self, kind):
        self.kind, self.number, self.clock = kind, next(COUNT), 0
        digest = hashlib.sha256(b"" if kind != "two hashes" else str(self.number).encode()).hexdigest()
        name = "broken:else" if kind == "another name" else f"broken:{kind}"
        sizes = (8, 2) if kind == "sizes" else (7, 2)
        self.info = PolicyInfo(name, "abc" if kind == "no hash" else digest, *sizes)

    def act(self, view, *, sample, generator=None, activations=False):
        if self.kind == "wide":
            return Decision(view.own.new_zeros(len(view.own), 3))
        if self.kind == "clock":
            self.clock = torch.where(view.first, 0.0, 0.0 if view.first.all() else self.clock) + 1
            return Decision(self.clock[:, None].expand(-1, 2) / 100)
        return Decision(view.own[:, :2].clone())


@hookimpl
def register_policies():
    return [PolicySpec("broken", f"{__name__}:load")]


def load(name):
    return Broken(name.replace("else", "other name"))
"""

CASES = [
    ("sizes", "loading", "takes 8 observations and gives 2 actions, but the evader has 7 and 2"),
    ("wide", "loading", "action must have shape (4, 2), got (4, 3)"),
    (
        "another name",
        "loading",
        "it says its name is 'broken:else', which loads one named 'broken:other name'",
    ),
    ("no hash", "hash", "info.sha256 must be 64 hex digits, got 'abc'"),
    ("two hashes", "hash", "loaded twice, it has two hashes"),
    ("clock", "same-actions", "a copy that loads its recurrent_state() does not go on as it does"),
]


def test_the_scripted_victim_passes_every_check(apil_check_victim) -> None:
    report = apil_check_victim("scripted:toy-pursuit/evader/v1", "toy-pursuit")
    assert report.checked == ["Loading", "Hash", "Acting", "Same actions", "Playing"]
    assert (report.name, report.side) == ("scripted:toy-pursuit/evader/v1", "evader")
    assert report.wins + report.ties + report.losses == 8


@pytest.mark.parametrize(("kind", "section", "text"), CASES)
def test_a_broken_victim_is_told_which_check_it_failed(
    tmp_path: Path, apil_files: None, kind: str, section: str, text: str
) -> None:
    (tmp_path / "broken_victims.py").write_text(BROKEN)
    with pytest.raises(ContractError) as caught:
        check_victim(f"broken:{kind}", "toy-pursuit", plugins=[tmp_path / "broken_victims.py"])
    message = str(caught.value)
    assert text in message
    assert message.endswith(f"\n  docs: testing.md#{section}")


def test_a_report_is_a_short_table() -> None:
    report = VictimReport(
        "still:x", "toy-pursuit", "evader", "ab" * 32, ["Loading"], ["recurrent"], 6, 0, 2, 1.5
    )
    assert str(report).splitlines() == [
        "victim still:x on toy-pursuit: 1 checks passed (1.5 s)",
        "  seat            evader",
        "  sha256          abababababababab",
        "  against random  6 won, 0 tied, 2 lost",
        "  note            recurrent",
    ]
