"""Reads a sensor on an I²C bus of this machine: the bus, the driver, and the FIFO that is read on time."""
