"""Readers of other programs' files, each with its library; `by_library` calls their `read(path, topic)`."""
