"""Third-party victims: one module per format, one convention for networks (docs/victims.md)."""
