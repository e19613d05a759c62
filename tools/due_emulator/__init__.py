"""The Arduino Due in software: it runs a firmware image for the real board in virtual time."""
