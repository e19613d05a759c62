"""Recordings: the MCAP format, readers of other files, recovery."""
