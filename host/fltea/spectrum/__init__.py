"""Spectra, fits, intervals, tests and the verdict."""
