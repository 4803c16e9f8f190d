"""``python:MODULE:CALLABLE``: runs only when trusted; mistakes in it are one line with its name."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
from helpers.small_runs import differences, final_state, small_config

from apil_core import VictimError, evaluate, load_policy, resume, run
from policies.foreign_files import seat, view

AGENTS = """
import torch
from apil_core import Decision, Policy, PolicyInfo

print("hello")

def chase(observation):
    return observation[:, :2].clamp(-1, 1)

def noisy(observation):
    return observation[:, :2], torch.zeros(2)

def network(seat):
    torch.manual_seed(0)
    return torch.nn.Linear(seat.observation_size, seat.action_size)

class Slow(Policy):
    def __init__(self, seat):
        self.size = seat.action_size
        self.before = None

    def act(self, view, *, sample, generator=None, activations=False):
        if self.before is None or len(self.before) != len(view.own):
            self.before = torch.zeros(len(view.own), self.size)
        self.before = torch.where(view.first.unsqueeze(1), 0.0, 0.9 * self.before + view.own[:, : self.size])
        return Decision(self.before)

    def recurrent_state(self):
        return {} if self.before is None else {"before": self.before}

    def load_recurrent_state(self, state):
        self.before = state.get("before")

def broken(observation):
    raise KeyError("no such thing")

class Odd(BaseException):
    pass


def odd(own):
    raise Odd("no way")


def odder(seat):
    raise Odd("no way")


def unmade(seat):
    raise RuntimeError("cannot be made")

def wrong(seat):
    return 3

number = 5
"""


@pytest.fixture
def agents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Name of a module in the current directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "their_agents.py").write_text(AGENTS)
    yield "their_agents"
    sys.modules.pop("their_agents", None)


def test_it_does_not_run_unless_trusted(agents: str) -> None:
    with pytest.raises(
        VictimError, match=r"^python:their_agents:chase runs code when it is loaded, and no file names"
    ):
        load_policy(f"python:{agents}:chase", seat=seat())
    with pytest.raises(VictimError, match="or add --trust"):
        run(small_config("adrl", victim=f"python:{agents}:chase"), out=Path("r"))
    assert agents not in sys.modules


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("chase", lambda own: own[:, :2].clamp(-1, 1)),
        ("noisy", lambda own: own[:, :2]),
        ("Slow", lambda own: 0 * own[:, :2]),
    ],
)
def test_functions_and_policies(
    agents: str,
    name: str,
    expected: Callable[[torch.Tensor], torch.Tensor],
    capsys: pytest.CaptureFixture[str],
) -> None:
    policy = load_policy(f"python:{agents}:{name}", seat=seat(), trust=True)
    assert policy.info.name == f"python:{agents}:{name}"
    assert (policy.info.observation_size, policy.info.action_size) == (7, 2)
    assert torch.equal(policy.act(view(), sample=False).action, expected(view().own))
    assert capsys.readouterr().out == "", "stdout is for results"


def test_a_factory_may_give_a_network(agents: str) -> None:
    policy = load_policy(f"python:{agents}:network", seat=seat(), trust=True)
    torch.manual_seed(0)
    with torch.no_grad():
        expected = torch.nn.Linear(7, 2)(view().own)
    assert torch.equal(policy.act(view(), sample=False).action, expected)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("their_agents:broken", r"their_agents:broken failed: KeyError: 'no such thing' \(APIL_DEBUG=1"),
        ("their_agents:unmade", "their_agents:unmade failed: RuntimeError: cannot be made"),
        ("their_agents:odd", "their_agents:odd failed: Odd: no way"),
        ("their_agents:odder", "their_agents:odder failed: Odd: no way"),
        ("their_agents:wrong", "expected a Policy, or a function from observations to actions, found int"),
        ("their_agents:number", "expected something callable, found int"),
        ("their_agents:nothing", r"their_agents \(.*their_agents\.py\): AttributeError: .*'nothing'"),
        ("no_agents:f", r"no_agents \(looked in .*\): ModuleNotFoundError: No module named 'no_agents'"),
        ("their_agents", "expected python:MODULE:CALLABLE"),
    ],
)
def test_mistakes_are_one_line(agents: str, name: str, expected: str) -> None:
    with pytest.raises(VictimError, match=f"^python:.*{expected}") as caught:
        load_policy(f"python:{name}", seat=seat(), trust=True)
    assert "\n" not in str(caught.value)


def test_a_run_against_it_is_resumed_bit_for_bit(agents: str) -> None:
    changes = {"victim": f"python:{agents}:Slow", "trust": True}
    run(small_config("apil", **changes), out=Path("whole"))
    run(small_config("apil", steps=1024, **changes), out=Path("parts"))
    resume("parts", steps=small_config().steps)
    assert differences(final_state("whole"), final_state("parts")) == []
    Path("their_agents.py").write_text(AGENTS.replace("0.9", "0.8"))
    with pytest.raises(VictimError, match="python:their_agents:Slow has changed since the run began"):
        resume("parts", steps=8192)


def test_it_can_be_the_adversary(agents: str) -> None:
    result = evaluate(f"python:{agents}:chase", env="toy-pursuit", episodes=10, trust=True)
    assert result.adversary.name == f"python:{agents}:chase"
    with pytest.raises(VictimError, match="runs code"):
        evaluate(f"python:{agents}:chase", env="toy-pursuit", episodes=10)
