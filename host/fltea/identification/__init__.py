"""Identify the noise of a whole recording, as `fltea identify` does."""
