"""``python -m apil_core.cli``: the command line where the console script is not on the path."""

from apil_core.cli import main

main()
