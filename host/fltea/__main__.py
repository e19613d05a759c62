"""`python -m fltea` is `fltea`."""

from fltea.cli.app import main

main()
