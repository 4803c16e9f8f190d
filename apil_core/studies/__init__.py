"""Studies of many runs: benchmarks, curves, reports, analyses."""
