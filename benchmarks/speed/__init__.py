"""How fast all is beside the physics alone: ``python -m benchmarks.speed``; see docs/benchmarking.md."""
