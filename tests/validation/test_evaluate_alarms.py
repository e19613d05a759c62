"""False alarms, counted in parts."""

import msgspec
import numpy as np
import pytest

from tools.validation.evaluate import alarms
from tools.validation.evaluate.alarms import Alarms, count_alarms


@pytest.mark.parametrize("noise", list(alarms.MAKERS))
def test_about_five_in_a_hundred(noise: str) -> None:
    """Of 200 short series; 3 or fewer and 19 or more have a chance of 1 % together."""
    found = [msgspec.convert(row["found"], Alarms) for row in count_alarms(noise, 200, (1_000,), 1)]
    assert [one.estimator for one in found] == ["live", "Whittle"]
    for one in found:
        assert (one.noise, one.samples, one.series) == (noise, 1_000, 200)
        assert 4 <= one.rejected <= 18
        assert one.rejected_1 <= one.rejected


@pytest.mark.parametrize("noise", list(alarms.MAKERS))
def test_the_noises_are_white_and_what_they_are_called(noise: str) -> None:
    y = alarms.MAKERS[noise](np.random.default_rng(1), (50_000, 2))
    assert float(np.asarray(np.corrcoef(y[1:, 0], y[:-1, 0]))[0, 1]) == pytest.approx(0, abs=0.02)
    assert float(np.asarray(np.corrcoef(y.T))[0, 1]) == pytest.approx(0, abs=0.02)
    assert ("LSB" in noise) == bool((y == np.rint(y)).all())
    fourth = float(((y - y.mean()) ** 4).mean() / y.var() ** 2)
    assert (fourth > 5) == (noise.startswith("t "))
