"""How often the null test rejects white noise, whose share of false alarms is to be 5 %."""

from collections.abc import Callable, Sequence
from typing import Literal

import msgspec
import numpy as np
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Binned, binned, periodogram
from numpy.typing import NDArray

from tools.validation.evaluate.cases import H
from tools.validation.evaluate.fits import live_data, rejects
from tools.validation.runner import Row, as_row

Array = NDArray[np.float64]

AT_ONCE = 100
"""Series of one task."""
MAKERS: dict[str, Callable[[np.random.Generator, tuple[int, int]], Array]] = {
    "Gaussian": lambda rng, shape: rng.standard_normal(shape),
    "Gaussian, σ = 1 LSB": lambda rng, shape: np.rint(rng.standard_normal(shape)),
    "t with 4 degrees": lambda rng, shape: rng.standard_t(4, shape),
}
"""White noise by name: (n, series)."""


Estimator = Literal["live", "Whittle"]


class Alarms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Of one kind of white noise after so many samples."""

    noise: str
    samples: int
    estimator: Estimator
    series: int
    rejected: int
    """at 5 %"""
    rejected_1: int
    """at 1 %"""

    @property
    def share(self) -> float:
        """Of false alarms at 5 %."""
        return self.rejected / self.series


def count_alarms(noise: str, series: int, lengths: Sequence[int], seed: int) -> list[Row]:
    """Count those of some series; seed: another one is another set of series."""
    rng = np.random.default_rng([seed, *noise.encode()])
    y = MAKERS[noise](rng, (lengths[-1], series))
    octaves, at, found = Octaves(series), 0, []
    for n in lengths:
        octaves.add(y[at:n])
        at = n
        whole = binned(periodogram(y[:n].T, H))
        alone = [whole._replace(power=whole.power[[i]]) for i in range(series)]
        both: tuple[tuple[Estimator, list[Binned]], ...] = (
            ("live", live_data(octaves, series, H)),
            ("Whittle", alone),
        )
        for name, data in both:
            five, one = np.sum([rejects(each, 0.05, 0.01) for each in data], axis=0).tolist()
            found.append(as_row("alarms", Alarms(noise, n, name, series, five, one)))
    return found
