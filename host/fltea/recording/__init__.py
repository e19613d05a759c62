"""Recordings of gyroscope samples: the MCAP format, readers of other formats, and recovery."""
