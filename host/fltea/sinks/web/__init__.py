"""Shared by the pages of one sensor and of a fleet: server, limits, and files for the browser."""
