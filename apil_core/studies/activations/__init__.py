"""A victim's activations against its opponents: a map, and how usual they are; docs/activations.md."""
