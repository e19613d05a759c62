"""Declare for each published number of a record, in one place, all outputs in which people see the number."""
