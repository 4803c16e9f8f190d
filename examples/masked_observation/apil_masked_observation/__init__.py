"""A defence: the victim does not see its opponent. Three observers, one way of masking each."""
