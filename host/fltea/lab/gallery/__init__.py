"""A gallery of noises whose truth is known, and what the verdict says of them: `fltea gallery`."""
