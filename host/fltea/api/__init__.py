"""Use fltea from Python, without the daemon: from arrays to immutable results.

All names can also be imported from `fltea` itself.
"""
