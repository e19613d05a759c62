"""What the search finds on one noise of a population, for the calibration of odds and for their judge."""

import zlib

import numpy as np
from fltea.identification.sums import examined
from fltea.spectrum.verdict import decide

from tools.validation.odds.populations import POPULATIONS, RATE_HZ, drawn
from tools.validation.runner import Row


def count(population: str, samples: int, first: int, series: int, seed: int) -> list[Row]:
    """Return a row for each of `series` noises from number `first` on: leads, odds and the verdict.

    ahead: by how much the best with an order is ahead after BIC's price, and of the richest without one in
    2 log L; None where the search found nothing that looks like an order.
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
