"""Intervals that are looked for about the last ones are those that are looked for everywhere."""

import numpy as np
import pytest
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes
from fltea.spectrum.warm import LOOK_AGAIN, Warm

from tools.validation.evaluate.cases import Case, samples

CASES = [Case(0.8, -1.0, 3.0), Case(0.4, -1.0, 0.3), Case(0.6, -3.0, 0.3), Case(0.8, -10.0, 30.0)]
FIGURES = ("alpha", "f", "F", "s2", "R")


@pytest.mark.slow
def test_in_nearly_all_fits_the_ends_are_the_same() -> None:
    y = np.ascontiguousarray(np.stack([samples(one, 1, 12_000, record=3)[:, 0] for one in CASES], axis=1))
    axes = tuple("abcd")
    warm, cold = (LiveAxes(axes, 0.01, LiveConfig(), "deg/s") for _ in range(2))
    compared = apart = 0
    for second in range(120):
        block = y[second * 100 : (second + 1) * 100]
        warm.add(block)
        cold.add(block)
        found = warm.fit(curves=False, fresh=second % 10 == 0)
        if second % 7 != 6 or second % 10 == 0:
            continue
        for axis, fit in cold.fit(curves=False, fresh=True).items():
            for name in FIGURES:
                ours, whole = getattr(found[axis], name), getattr(fit, name)
                compared += 1
                if ours.low is None or whole.low is None:
                    apart += ours.low is not whole.low
                    continue
                margin = 0.1 * (whole.high - whole.low)
                same = ours.low == pytest.approx(whole.low, abs=margin)
                apart += not (same and ours.high == pytest.approx(whole.high, abs=margin))
    assert compared > 250
    assert apart <= 0.02 * compared


def test_what_was_looked_for_is_kept_until_the_record_has_grown() -> None:
    warm, looks = Warm(), []

    def look() -> int:
        looks.append(0)
        return len(looks)

    assert [warm.looked("x", n, look) for n in (100.0, 100 * LOOK_AGAIN, 101 * LOOK_AGAIN)] == [1, 1, 2]
    assert warm.looked("y", 1.0, look) == 3
    warm.forget()
    assert warm.looked("x", 100.0, look) == 4
