"""The command line; related commands share a module."""

import gc

# The program makes hardly any reference cycles; searching for them as often as usual takes 3 % of a run.
gc.set_threshold(20_000)
