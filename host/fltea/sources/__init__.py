"""Sources of events: ports, buses, files, brokers and a simulation."""
