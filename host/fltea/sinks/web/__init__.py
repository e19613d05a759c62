"""What the pages of one sensor and of a fleet have in common: server, limits, and files for the browser."""
