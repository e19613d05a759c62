"""Reads gyroscopes and IMUs through their drivers in the Linux kernel (IIO, industrial I/O)."""
