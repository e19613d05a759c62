"""Connections to MQTT brokers, for outputs, sources and the fleet alike."""
