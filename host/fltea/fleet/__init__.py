"""`fltea fleet`: shows all sensors whose daemons publish over MQTT on one web page."""
