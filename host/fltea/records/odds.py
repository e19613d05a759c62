"""Write the odds that a noise has an order (is fractional) as text for people."""

MOST = 50.0
"""Larger odds are shown as "more than 50 : 1", since the calibration of the odds was not checked beyond this
value.
"""


def odds(value: float) -> str:
    """Return the odds as "N : 1", with N at most `MOST`. Odds below 1 are shown as "1 : N"."""
    if value < 1:
        return f"1 : {odds(1 / value).split(' : ')[0]}" if value > 0 else "none"
    if value >= MOST:
        return f"more than {MOST:.0f} : 1"
    return f"{value:.1f} : 1" if value < 3 else f"{value:.0f} : 1"
