"""Judging the online filters: bias, spread and coverage over noises whose order is known."""
