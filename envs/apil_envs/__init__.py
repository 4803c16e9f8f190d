"""The games of APIL, registered through the same hooks as third-party games; see :mod:`apil_envs.plugin`."""
