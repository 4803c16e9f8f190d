"""A victim's activations against its opponents: a t-SNE map and their likelihood; docs/activations.md."""
