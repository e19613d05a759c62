"""The command line. Related commands are in one module."""

import gc

# The program makes hardly any reference cycles. Searching for them as often as Python does by default takes 3
# % of a run.
gc.set_threshold(20_000)
