"""Victims of other people's making: one module per format, one convention for networks (docs/victims.md)."""
