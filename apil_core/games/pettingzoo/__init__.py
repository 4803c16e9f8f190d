"""PettingZoo ``ParallelEnv``s of others as games: ``pettingzoo:module:callable`` (docs/pettingzoo.md)."""
