"""Provide what the pages of a sensor and of a fleet share: web server, limits, files for the browser."""
