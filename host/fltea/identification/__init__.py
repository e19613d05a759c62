"""What the noise of a whole recording is: `fltea identify`."""
