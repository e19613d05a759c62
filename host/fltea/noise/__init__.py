"""What a fractional noise is: weights, spectra, simulation (pure)."""
