"""`python -m fltea` is `fltea`."""

import sys
from pathlib import Path

# `python -m` searches the current folder first, so it would import a random.py that lies next to a recording
# in place of Python's own module. So the current folder is removed from the search path, unless the package
# fltea itself is in it.
if not sys.flags.safe_path and Path(sys.path[0]) != Path(__file__).parents[1]:
    del sys.path[0]

from fltea.cli.start import main

main()
