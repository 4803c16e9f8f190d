"""Recorders that hand a run's metrics to experiment trackers: Weights & Biases and Trackio."""
