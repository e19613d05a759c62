"""Sources of samples and other events: serial ports, I²C buses, files, brokers and a simulation."""
