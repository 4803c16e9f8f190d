"""Finding, checking and running plugins."""
