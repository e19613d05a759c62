"""Run FLTEA on blocks of samples: start-up window, filters, and the supervisor that restarts bad filters."""
