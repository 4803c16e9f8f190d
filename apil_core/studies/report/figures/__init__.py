"""Figures of the page, one family per file. matplotlib is imported where a figure is drawn, not before."""
