"""What is made of many runs: benchmarks, curves, reports, analyses."""
