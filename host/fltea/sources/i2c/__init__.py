"""Reads a sensor on an I²C bus of this computer: opens the bus, drives the sensor, and reads its FIFO."""
