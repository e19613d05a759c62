"""A sensor on an I²C bus of this machine: bus, driver, and its FIFO read on time."""
