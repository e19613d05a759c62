"""`fltea fleet`: what the daemons of many sensors publish over MQTT, seen in one place."""
