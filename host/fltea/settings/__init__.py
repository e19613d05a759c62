"""All that the program can be told."""
