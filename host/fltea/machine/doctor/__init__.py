"""`fltea doctor`: what lies between the sensor and the records, looked at check by check."""
