"""Identifies the noise of thousands of recordings: workers read files, and one table lists the results."""
