"""Use fltea from Python, without the daemon. Functions take arrays and return immutable results.

All names can also be imported from `fltea` itself.
"""
