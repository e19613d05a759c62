"""Reads a sensor on an I²C bus of this computer: bus, driver, and FIFO."""
