"""Many devices behind one source: who is let in, what waits, and whose turn it is."""
