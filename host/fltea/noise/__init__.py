"""Model fractional noise: weights, spectra, simulation; and the distributions that tests need."""
