"""fltea: online identification of fractional noise of MEMS gyroscopes."""

__version__ = "0.1.0"
