#!/usr/bin/python3 -I
"""Runs fltea with the libraries in /usr/lib/fltea, isolated from the user's packages and environment."""

import sys

if __name__ == "__main__":
    sys.path.insert(0, "/usr/lib/fltea")
    from fltea.cli.start import main

    main()
