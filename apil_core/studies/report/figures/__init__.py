"""Figures of the page, one family per file. matplotlib is imported when a figure is drawn, not before."""
