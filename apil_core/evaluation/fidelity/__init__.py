"""Games beside their originals."""
