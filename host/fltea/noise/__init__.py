"""What a fractional noise is: weights, spectra, simulation; and the distributions that tests need (pure)."""
