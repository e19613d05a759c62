"""Constants for converting figures to the units that people read."""

import math

HOUR, SQRT_HOUR = 3600.0, 60.0
"""Number of seconds in an hour (3,600), and the square root of this number: 1 √h is 60 √s."""

STANDARD_GRAVITY_MS2 = 9.80665
"""The standard acceleration of free fall (ISO 80000-3)."""

MOST_DEG = 180.0
"""If the standard deviation of an angle is larger than this, which is half a turn, any heading is possible
[deg].
"""

HEADING_AFTER_S = 60
"""Texts for people say how far the heading is off after this time without rest [s]."""

FLICKER = math.sqrt(2 * math.log(2) / math.pi)
"""Height of the flat part of an Allan deviation divided by the bias instability B, 0.664 (IEEE 952, annex
C).
"""
