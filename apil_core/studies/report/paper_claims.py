"""What the paper claims, and what its own tables show."""

from __future__ import annotations

from apil_core.studies.report.table_models import Metric

MARGIN = 0.1
"""Largest loss that counts as none, where a claim says that nothing is lost: ten points."""

ORDER = ("adrl", "apl", "apil", "e_apil")
"""The paper's methods, weakest first by its claim."""

WORDS: dict[Metric, str] = {"win": "wins", "win_or_tie": "win+tie"}

IN_THE_PAPER = {
    "beats baseline": "The paper's table 1 (win+tie): above in 15 of 16; below: adrl 41 against baseline 56 "
    "in sumo-ants.",
    "order": "The paper's table 1 (win+tie): above in 8 of 12; below: apil 58 against apl 68 in "
    "you-shall-not-pass, e_apil 87 against apil 88 in sumo-humans, e_apil 80 against apil "
    "81 in sumo-ants.",
    "order on wins": "The paper's table 1 (wins): above in 8 of 12; below: apil 58 against apl 68 in "
    "you-shall-not-pass, e_apil 72 against apil 73 in sumo-humans, apl 2 against adrl 10 "
    "in sumo-ants.",
    "blinding": "The paper's tables 1 and 2 (win+tie): more than 10 points lost by baseline 38 → 1 in "
    "you-shall-not-pass, apl 77 → 62 in sumo-humans, baseline 56 → 42 in sumo-ants, apl "
    "81 → 64 in sumo-ants. In kick-and-defend both rows are equal in every cell, as if "
    "nothing had been blinded.",
    "resists": "The paper's table 4 (wins): above in 3 of 4, never below.",
    "remembers": "The paper's table 3 (wins): more than 10 points lost by adrl 93 → 76 in sumo-humans, "
    "apl 93 → 79 in sumo-humans, adrl 44 → 24 in sumo-ants, apl 44 → 30 in sumo-ants, "
    "apil 44 → 29 in sumo-ants, e_apil 44 → 33 in sumo-ants.",
}
"""By claim: what the published numbers show of it, counted over their cells."""
