"""Whole runs: training, hardening a victim, distilling a student."""
