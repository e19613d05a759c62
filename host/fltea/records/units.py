"""Constants that turn figures into what people read."""

import math

HOUR, SQRT_HOUR = 3600.0, 60.0
"""From seconds to hours, and from √s to √h."""

STANDARD_GRAVITY_MS2 = 9.80665
"""The standard acceleration of free fall (ISO 80000-3)."""

MOST_DEG = 180.0
"""With a standard deviation beyond half a turn an angle can be any: no heading is left."""

FLICKER = math.sqrt(2 * math.log(2) / math.pi)
"""σ / B at the floor of an Allan deviation, 0.664 (IEEE 952, annex C)."""
