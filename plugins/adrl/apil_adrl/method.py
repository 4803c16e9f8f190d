"""ADRL's method object."""

from __future__ import annotations

from apil_core import Method


class Adrl(Method):
    """ADRL: objective r^α, own observation, no auxiliary model (Gleave et al. 2020, §4)."""
