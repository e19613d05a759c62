"""Many devices behind one source: which are admitted, what waits, and which worker serves them."""
