"""Identification of fractional noise: weights, memory, three filters, the gyroscope case, start-up window."""
