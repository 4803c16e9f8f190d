"""README's everyday commands as a chain, in their order, on small budgets."""

from __future__ import annotations

import re

import pytest

from docs.conftest import Apil
from docs.pages import README, commands, sections

SMALL = {
    "run": "--steps 512 --num-envs 8 --threads 1 --quiet --set ppo.num_steps=32 --set ppo.minibatches=2 "
    "--set evaluation.episodes=4 --set evaluation.every_steps=0",
    "resume": "--steps 768 --quiet",
    "eval": "--episodes 4 --quiet",
    "play": "--quiet",
    "crossplay": "--episodes 4 --num-envs 4 --quiet",
    "retrain": "--steps 512 --num-envs 8 --episodes 4 --quiet --set ppo.num_steps=32 --set critic_warmup=0",
    "analyze": "--games 2 --quiet",
    "distill": "--steps 512 --num-envs 8 --episodes 4 --quiet --teacher embedded:sumo-ants/fighter/v1 "
    "--opponent embedded:sumo-ants/fighter/v1 --set final_passes=1",
    "fidelity": "--episodes 2 --num-envs 2 --quiet",
}
"""Flags by verb: they replace README's, or come in addition."""


def small(words: list[str]) -> list[str]:
    """A command with a small budget, against embedded victims."""
    text = " ".join(words).replace("zoo:", "embedded:").replace("--until win", "--until loss")
    flags = SMALL.get(words[0], "")
    if words[0] == "run" and "toy-pursuit" not in words:  # short games are won, so --show ends
        flags += " --set game.max_steps=30"
    for flag in re.findall(r"--(?!set)[\w-]+", flags):
        text = re.sub(rf" {flag} [^-]\S*", "", text)
    return f"{text} {flags}".split()


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_everyday_commands_run_in_their_order(apil: Apil) -> None:
    text = sections(README)["Everyday commands"].split("```")[1]
    lines = [words for words in commands(README) if " ".join(words) in text]
    chain = [line.split(" #")[0].split()[1:] for line in text.splitlines() if line.startswith("apil ")]
    assert len(chain) > 15
    assert all(words in lines for words in chain)
    for words in chain:
        done = apil(*small(words))
        expected = 1 if words[0] == "fidelity" else 2 * (words[0] == "victims")  # they need the zoo itself
        assert done.code == expected, f"apil {' '.join(small(words))}: {done.err}"
