"""Process the samples of many devices that publish to one broker, in one process or in several (workers)."""
