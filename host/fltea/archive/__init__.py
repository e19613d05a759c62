"""Recordings as a whole: made, summed up, exported."""
