"""`fltea fleet`: one page for all sensors whose daemons publish over MQTT."""
