"""Whole recordings: made, summarised, exported."""
