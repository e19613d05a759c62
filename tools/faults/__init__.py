"""Plays every fault of every part, and reports the results in one table: `make faults`."""
