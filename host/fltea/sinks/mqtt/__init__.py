"""Publish records to an MQTT broker."""
