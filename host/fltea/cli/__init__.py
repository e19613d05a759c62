"""The command line, one file a command."""

import gc

# Hardly anything here is in a cycle: to look for them as often as usual takes a thirtieth of a run.
gc.set_threshold(20_000)
