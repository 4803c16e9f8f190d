"""From files, presets and flags to one checked configuration."""
