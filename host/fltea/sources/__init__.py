"""The sources that events come from."""
