"""FLTEA on blocks of samples: the start-up window, the filters, and the supervisor that judges them."""
