"""Reads gyroscopes and IMUs by their drivers of the Linux kernel (IIO, industrial input and output)."""
