"""Every fault of every part, in one report: `make faults`."""
