"""Readers of other programs' files, each by its own library: `read(path, topic)` is called by `foreign`."""
