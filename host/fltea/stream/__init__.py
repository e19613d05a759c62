"""The walk of a block: place, time, units, estimates, records."""
