"""The stream of one device: times and units of its samples, estimates, fits, and the records of these."""
