"""Declare once, for each published number of a record, all outputs in which people see it."""
