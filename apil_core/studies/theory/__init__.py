"""The methods' theory on games small enough for exact numbers, and what it says of a run (docs/theory.md)."""
