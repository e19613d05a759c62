"""Records to an MQTT broker."""
