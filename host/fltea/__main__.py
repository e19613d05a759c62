"""`python -m fltea` is `fltea`."""

from fltea.cli import main

main()
