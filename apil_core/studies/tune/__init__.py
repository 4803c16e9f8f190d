"""Tuning: a study of many short runs that looks for the settings which win most."""
