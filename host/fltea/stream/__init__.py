"""One device's samples: their time and units, estimates, fits, and the records of them."""
