"""Use fltea from Python: arrays in, frozen records out, no daemon. All names are also in `fltea` itself."""
