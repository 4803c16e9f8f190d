"""The methods' theory on games small enough for exact numbers, and on games of a run (docs/theory.md)."""
