#!/usr/bin/python3 -I
"""Runs fltea with the libraries of its own folder, and nothing of the user's or of the environment."""

import sys

if __name__ == "__main__":
    sys.path.insert(0, "/usr/lib/fltea")
    from fltea.cli.app import main

    main()
