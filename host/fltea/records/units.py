"""Constants for converting figures to the units that people read."""

import math

HOUR, SQRT_HOUR = 3600.0, 60.0
"""Number of seconds in an hour, and the square root of it: the number of √s in a √h."""

STANDARD_GRAVITY_MS2 = 9.80665
"""The standard acceleration of free fall (ISO 80000-3)."""

MOST_DEG = 180.0
"""Largest standard deviation with which an angle is known [deg]. Beyond half a turn, any heading is possible.
"""

HEADING_AFTER_S = 60
"""Texts state the error that the heading has this long after the last sample at rest [s]."""

FLICKER = math.sqrt(2 * math.log(2) / math.pi)
"""Height of the flat part of an Allan deviation divided by the bias instability B, 0.664 (IEEE 952, annex
C).
"""
