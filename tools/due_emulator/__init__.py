"""The Arduino Due in software: runs an image for the real board in virtual time."""
