"""Records as Prometheus metrics."""
