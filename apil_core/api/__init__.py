"""What plugins are written against: hooks, specs, games, policies, methods, settings."""
