"""Identifies thousands of recordings: workers read them, and their verdicts form one table."""
