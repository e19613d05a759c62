"""Serve the live page, which shows the devices in a browser."""
