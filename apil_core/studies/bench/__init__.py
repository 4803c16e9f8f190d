"""``apil bench run``: many runs as one benchmark, from a matrix of methods, games, seeds and settings."""
