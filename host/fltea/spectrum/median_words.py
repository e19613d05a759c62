"""The words of a verdict for noise that has passed through a median filter."""

from fltea.noise.part import in_hz
from fltea.spectrum import wording
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.median_filter import MedianFilter
from fltea.spectrum.reading import SLOW_SAYS, Reading, corner_hz

FLAT = 0.1
"""A median filter has almost no effect if the product of frequency and window length is below this."""
NEXT = (
    "Switch the filter off in the program that wrote the file, or use N as that of the filtered noise: "
    "what the noise was before the filter cannot be known."
)


def explains(e: Evidence, found: Reading) -> bool:
    """Return whether the median filter alone may explain all parts of the model except white noise."""
    assert e.median is not None
    flat_hz = FLAT * e.rate_hz / e.median.samples
    if e.from_hz > flat_hz:
        return True  # the record is so short that the filter affects all fitted frequencies
    # A relaxation with a high corner frequency may describe the filter. Other slow noise cannot.
    slow = found.says & SLOW_SAYS - {"relaxations"}
    return not slow and all(corner_hz(part) > flat_hz for part in found.relaxations)


def verdict(e: Evidence, median: MedianFilter) -> tuple[str, str, str]:
    """Return the texts `what`, `why` and `next` of the verdict."""
    shaped_hz, _ = median.shaped_hz(1 / e.rate_hz, e.duration_s)
    return (
        f"White noise through {median.words}.{wording.also_found(e, with_median=False)}",
        f"{median.share:.0%} of the values equal the value before them, which no linear filter can cause: "
        f"the median filter shapes the spectrum above {in_hz(shaped_hz)}, and {wording.UNDEFINED}.",
        NEXT,
    )
