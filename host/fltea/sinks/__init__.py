"""The outputs that records go to."""
