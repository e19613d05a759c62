"""The version of the program. It stands here, on the ground, so that no room imports the package's top."""

__version__ = "0.1.0"
