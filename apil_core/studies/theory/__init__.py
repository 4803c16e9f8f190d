"""What the methods' theory says of a run (docs/theory.md)."""
