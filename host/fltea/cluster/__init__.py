"""Recordings by the thousand: listed, read and identified by workers, their verdicts in one table."""
