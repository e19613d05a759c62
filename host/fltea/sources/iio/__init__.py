"""Gyroscopes and IMUs with a driver of the Linux kernel (IIO, industrial input and output)."""
