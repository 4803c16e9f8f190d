"""The environment of an attack, PPO, and what a run keeps."""
