"""Noises of parts, and what is counted of them."""

import numpy as np
import pytest
from fltea.noise.parts import spectrum

from tools.validation.evaluate.cases import H
from tools.validation.evaluate.composites import (
    COMPOSITES,
    RATE_HZ,
    count_claims,
    count_composite,
    mixture,
    truth_of,
)


@pytest.mark.parametrize("name", list(COMPOSITES))
def test_the_truth_has_the_spectrum_that_is_drawn(name: str) -> None:
    lam = np.geomspace(1e-3, 3, 40)
    expected = np.sum([part.spectrum(lam, RATE_HZ) for part in COMPOSITES[name]], axis=0)
    np.testing.assert_allclose(spectrum(truth_of(COMPOSITES[name]), lam, H), expected, rtol=1e-6)


def test_intervals_hold_the_truth() -> None:
    """20 series: 95 % give 19, and 15 or fewer have a chance of 3 in a thousand."""
    rows = count_composite("two relaxations", 20)
    assert [row["quantity"].split(" of ")[0] for row in rows] == ["sigma", "tau_s", "sigma", "tau_s", "R"]
    assert rows[0]["same"] >= 16
    assert min(row["held"] - row["same"] for row in rows) >= -4


def test_mixtures_are_not_called_fractional() -> None:
    (row,) = count_claims(3_000, 30)
    assert sum(row["verdicts"].values()) == 30
    assert row["verdicts"].get("fractional", 0) <= 1
    rng = np.random.default_rng(1)
    assert len({len(mixture(rng)) for _ in range(50)}) > 2
