"""Odds in words (pure)."""

MOST = 50.0
"""Odds beyond are told as these: so few noises have them that the calibration was not checked there."""


def odds(value: float) -> str:
    """Return odds of 1 or more, which are told up to MOST; below 1 as those of the contrary."""
    if value < 1:
        return f"1 : {odds(1 / value).split(' : ')[0]}" if value > 0 else "none"
    if value >= MOST:
        return f"more than {MOST:.0f} : 1"
    return f"{value:.1f} : 1" if value < 3 else f"{value:.0f} : 1"
