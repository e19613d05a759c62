"""`fltea doctor`: checks of everything from the sensor to the outputs."""
