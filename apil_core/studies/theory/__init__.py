"""The methods' theory applied to runs (docs/theory.md)."""
