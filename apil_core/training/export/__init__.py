"""Adversaries as files."""
