"""The program from Python: arrays in, frozen records out, no daemon. All of it is under `fltea` too."""
