"""Readers of other programs' files, each with its library. `by_library` calls `read(path, topic)` of each."""
