"""Sources of samples and other events: serial ports, I²C buses, files, MQTT brokers and a simulation."""
