"""Convert durations, given in samples or as a time such as "30 s", to numbers of samples."""

import math
import re

Duration = int | str
"""A number of samples, or a time as text. Such a text is a number followed by a unit in `SECONDS`."""

SECONDS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
EXAMPLE = "30 s"
MOST_S = 1e9
"""Longest time that is accepted [s], about thirty years."""


def in_samples(value: Duration, rate_hz: float, least: int) -> int:
    """Return a duration as a number of samples at the sampling rate `rate_hz`.

    If a duration is given as a time above 0 s, it becomes at least `least` samples.
    """
    if not isinstance(value, str):
        return value
    seconds = in_seconds(value)
    assert seconds is not None, value  # Setting.accepts has checked that the text is a time
    return max(least, round(seconds * rate_hz)) if seconds else 0


def known(name: str, value: Duration) -> int:
    """Return a duration that is given in samples; raise ValueError if the duration is given as a time."""
    if isinstance(value, str):
        raise ValueError(
            f"{name} is a time, {value}: `at` converts it to samples as soon as the rate is known"
        )
    return value


def in_seconds(text: str) -> float | None:
    """Return the seconds of a time such as "30 s"; None for any other text."""
    found = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*([a-z]+)\s*", text)
    if found is None or found[2] not in SECONDS:
        return None
    seconds = float(found[1]) * SECONDS[found[2]]
    return seconds if math.isfinite(seconds) and seconds < MOST_S else None
