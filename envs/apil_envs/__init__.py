"""The games of APIL, registered through the same hooks a third party uses; see :mod:`apil_envs.plugin`."""
