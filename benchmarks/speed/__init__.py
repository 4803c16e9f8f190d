"""Speed of every level relative to physics alone: ``python -m benchmarks.speed``; docs/benchmarking.md."""
