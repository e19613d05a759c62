"""The version of the program, in the lowest package, so that no package has to import `fltea` itself."""

__version__ = "0.1.0"
