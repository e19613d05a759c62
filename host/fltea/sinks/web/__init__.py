"""Provide what the live page and the fleet's page share: web server, limits, files for the browser."""
