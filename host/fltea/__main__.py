"""`python -m fltea` is `fltea`."""

import sys
from pathlib import Path

# `python -m` looks for modules in the current folder first: a random.py beside a recording would be run for
# Python's own. Only where fltea itself is there it stays.
if not sys.flags.safe_path and Path(sys.path[0]) != Path(__file__).parents[1]:
    del sys.path[0]

from fltea.cli.app import main

main()
