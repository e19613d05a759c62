"""Read gyroscopes and IMUs by their drivers in the Linux kernel (IIO, industrial I/O)."""
