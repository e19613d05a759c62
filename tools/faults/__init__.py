"""Causes every fault of every part of the system, and reports the results in one table: `make faults`."""
