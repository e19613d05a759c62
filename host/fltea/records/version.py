"""State the version of the program, in a package that all others may import."""

__version__ = "0.1.0"
