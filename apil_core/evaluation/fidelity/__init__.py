"""Comparison of games with their originals."""
