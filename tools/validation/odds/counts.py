"""Counts the results of the model search on random noises, to calibrate and validate the odds of an order."""

import zlib

import numpy as np
from fltea.identification.sums import examined
from fltea.spectrum.verdict import decide

from tools.validation.odds.populations import POPULATIONS, RATE_HZ, drawn
from tools.validation.runner import Row


def count(population: str, samples: int, first: int, series: int, seed: int) -> list[Row]:
    """Return a row for each of `series` noises from number `first` on, with odds and verdict.

    `lead`: BIC of the best model without an order, minus that of the best model with one.
    `over_rich`: 2 log L (L: likelihood) of the best model with an order, minus that of the model without an
    order that has the most parameters.

    Both are None if the search found no model with an order.
    """
    rows: list[Row] = []
    for number in range(first, first + series):
        rng = np.random.default_rng([seed, samples, zlib.crc32(population.encode()), number])
        parts = POPULATIONS[population][0](rng, samples)
        e = examined(drawn(parts, samples, rng), 1 / RATE_HZ).evidence
        f, verdict = e.candidates, decide(e)
        has = f.ordered is not None
        rows.append(
            {
                "population": population,
                "samples": samples,
                "number": number,
                "ordinates": f.ordinates,
                "lead": f.lead if has else None,
                "over_rich": f.lead_over_rich if has else None,
                "odds": verdict.odds,
                "kind": verdict.kind,
            }
        )
    return rows
