"""What checks of `fltea doctor` get and return, for the modules of sources and outputs."""
