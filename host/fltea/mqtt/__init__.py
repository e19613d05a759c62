"""Connections to MQTT brokers, which outputs, sources and the table of many devices use."""
