"""Helpers without dependencies on other layers: errors, files, seeds, statistics, documents."""
