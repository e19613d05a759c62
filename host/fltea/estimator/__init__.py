"""FLTEA on blocks of samples: start-up window, filters, supervisor."""
