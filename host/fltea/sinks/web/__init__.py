"""Provide what the live page and the page of the fleet share: web server, limits, files for the browser."""
