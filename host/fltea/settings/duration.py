"""How long something lasts: in samples, or a time such as "30 s", of which the rate makes samples."""

import math
import re

Duration = int | str
"""Samples, or a number with one of `SECONDS` behind it."""

SECONDS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
EXAMPLE = "30 s"
MOST_S = 1e9
"""Thirty years; nothing waits longer."""


def in_samples(value: Duration, rate_hz: float, least: int) -> int:
    """The number of samples at a rate; of a time above 0 at least `least`."""
    if not isinstance(value, str):
        return value
    seconds = in_seconds(value)
    assert seconds is not None, value  # the declaration of the setting has seen it
    return max(least, round(seconds * rate_hz)) if seconds else 0


def known(name: str, value: Duration) -> int:
    """What is in samples already; ValueError for a time."""
    if isinstance(value, str):
        raise ValueError(f"{name} is a time, {value}: `at` makes samples of it once the rate is known")
    return value


def in_seconds(text: str) -> float | None:
    """Seconds of a time such as "30 s"; None for anything else."""
    found = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*([a-z]+)\s*", text)
    if found is None or found[2] not in SECONDS:
        return None
    seconds = float(found[1]) * SECONDS[found[2]]
    return seconds if math.isfinite(seconds) and seconds < MOST_S else None
