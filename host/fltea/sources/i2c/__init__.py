"""Read a sensor on an I²C bus of this machine: bus, driver, and FIFO."""
