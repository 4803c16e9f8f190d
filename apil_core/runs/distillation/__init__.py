"""Compact students of agents whose weights may not be shipped (``apil distill``)."""
