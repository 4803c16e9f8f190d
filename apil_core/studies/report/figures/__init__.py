"""Figures of a report, one family per file. plotly is imported where a figure is made, not before."""
