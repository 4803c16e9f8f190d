"""Every adversary against every victim."""
