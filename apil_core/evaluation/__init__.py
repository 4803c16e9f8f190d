"""Playing and scoring games."""
