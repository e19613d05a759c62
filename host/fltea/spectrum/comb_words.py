"""The words of a verdict for an event that repeats at equal intervals."""

from fltea.spectrum.spectral_lines import Repeats

MAINS_HZ = (50.0, 60.0, 100.0, 120.0)
SAME_FREQUENCY = 4e-3
"""A frequency counts as mains hum if it differs from one of MAINS_HZ by less than this proportion of it.
Large power grids keep their frequency within 0.4 % (0.2 Hz at 50 Hz).
"""
NEXT = (
    "Look for what runs with that period: a logger that writes its buffer, a GPS pulse, a heater, a radio. "
    "It is left out of all figures of the noise."
)
NEXT_MAINS = (
    "That is the period of mains hum with its harmonics: look for a power supply, a transformer or a lamp. "
    "It is left out of all figures of the noise."
)


def happens(found: Repeats, share: float) -> str:
    """Return the beginning of a sentence that says what repeats and how often.

    `share`: proportion of all power that the repeating event has.
    """
    return f"Something happens every {every(found.period_s)}: {_looks(found, share)}"


def what(found: Repeats, share: float) -> str:
    """Return a part of a sentence that says what repeats and how often.

    `share`: proportion of all power that the repeating event has.
    """
    return f"something that happens every {every(found.period_s)} ({_looks(found, share)})"


def _looks(found: Repeats, share: float) -> str:
    part = f"{share:.1%} of the power in {found.harmonics} multiples of {1 / found.period_s:.3g} Hz"
    if found.shape == "glitch" and found.duration_s is not None:
        return f"a glitch of {every(found.duration_s)} and {found.deviations:.2g} σ on the average, {part}"
    return f"a wave, {part}" if found.shape == "wave" else part


def every(seconds: float) -> str:
    """Return words for a period: three digits, and the unit that a person would choose."""
    return f"{seconds:#.3g} s".replace(". s", " s") if seconds >= 0.1 else f"{seconds * 1e3:.3g} ms"


def next_step(found: Repeats) -> str:
    """Return a text that says what the user can do about the repeating event."""
    mains = any(abs(found.period_s * hz - 1) < SAME_FREQUENCY for hz in MAINS_HZ)
    return NEXT_MAINS if mains else NEXT
