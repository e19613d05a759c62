"""Settings of the live maximum-likelihood fit, the table `live` of the TOML file."""

import math
import re

import msgspec

SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
DURATION = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(s|min|h|d)\s*")

SHORTEST_MEMORY_S, LONGEST_MEMORY_S = 10.0, 366 * 86400.0

TUNED_WITHIN = 2.0
"""The fit hands s2 and R to the filters where the upper end of each one's 95 % interval is at most so many
times the lower: filters that have believed a worse figure for a while do not come back
(host/docs/evaluation/live.md)."""


class LiveConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The spectrum and the fit of every axis, live.

    on: whether there is a fit at all. period_s: seconds of samples between fits; None: 1, but in a replay at
    full speed no sooner than the record has grown by a tenth. memory: time constant with which older
    samples are forgotten, such as "10min"; None: nothing is. target: half the width of α's interval that
    `until_s` asks for.
    """

    on: bool = True
    period_s: float | None = None
    memory: str | None = None
    target: float = 0.05

    @property
    def memory_s(self) -> float | None:
        """`memory` in seconds."""
        return None if self.memory is None else duration_s(self.memory)

    def __post_init__(self) -> None:
        if self.period_s is not None and not 0.1 <= self.period_s <= 86400:
            raise ValueError("period_s must be 0.1 to 86400 seconds")
        if self.memory is not None and not SHORTEST_MEMORY_S <= duration_s(self.memory) <= LONGEST_MEMORY_S:
            raise ValueError("memory must be 10 s to 366 d")
        if not (math.isfinite(self.target) and 0.001 <= self.target <= 1):
            raise ValueError("target is half the width of an interval of α and must be 0.001 to 1")


def duration_s(text: str) -> float:
    """Seconds of a text such as "90s", "10min", "2h" or "1d".

    Raises:
        ValueError: it is not of that form.
    """
    found = DURATION.fullmatch(text)
    if found is None:
        raise ValueError(f'"{text}" is no duration: write for instance "90s", "10min", "2h" or "1d"')
    return float(found[1]) * SECONDS[found[2]]
