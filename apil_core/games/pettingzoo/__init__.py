"""Third-party PettingZoo ``ParallelEnv``s as games: ``pettingzoo:module:callable`` (docs/pettingzoo.md)."""
