"""Recorders that send a run's metrics to experiment trackers: Weights & Biases and Trackio."""
