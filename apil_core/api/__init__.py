"""Interfaces for plugins: hooks, specs, games, policies, methods, settings."""
