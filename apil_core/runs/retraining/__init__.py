"""Hardened victims: a victim's own network, trained against an adversary and the one it already knows."""
