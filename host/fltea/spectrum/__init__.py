"""Identify noise by its spectrum: fits of noise models, intervals, tests, and the verdict."""
