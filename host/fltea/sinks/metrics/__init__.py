"""Serve records as Prometheus metrics."""
