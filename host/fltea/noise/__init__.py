"""Models of noise: parts, spectra, linear systems, simulation; and distributions for statistical tests."""
