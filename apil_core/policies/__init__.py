"""Frozen agents to attack: the zoo of Bansal et al. 2018, and two baselines."""
