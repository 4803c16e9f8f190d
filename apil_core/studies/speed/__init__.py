"""How fast everything is beside the physics alone: ``apil bench speed``; see docs/benchmarking.md."""
