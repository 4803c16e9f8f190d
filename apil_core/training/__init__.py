"""The environment of an attack, PPO, and a run's files."""
