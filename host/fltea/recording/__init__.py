"""Recordings in MCAP files: what is in them, written, read back, recovered, summed up and exported."""
