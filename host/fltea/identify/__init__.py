"""Identification of a recording: α and f with what they are worth, against the rivals that they have."""
