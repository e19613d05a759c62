"""Fits and intervals that begin at the last answer: as good as those from all starts."""

import numpy as np
import pytest
from fltea.settings.live import LiveConfig
from fltea.spectrum import warm as warm_fits
from fltea.spectrum.live_axes import LiveAxes
from fltea.spectrum.models import AR2, FULL, TWO_AR1
from fltea.spectrum.periodogram import Binned, binned, periodogram
from fltea.spectrum.warm import LOOK_AGAIN, Warm
from fltea.spectrum.whittle import Model, fit
from identify_support import H, long_recursion, white

from tools.validation.evaluate.cases import Case, samples


def series(n: int) -> Binned:
    return binned(periodogram(long_recursion(0.7, -0.05, 40_000, 3)[:n] + white(40_000, 1, 4)[0][:n], H))


@pytest.mark.parametrize("model", [FULL, AR2, TWO_AR1], ids=lambda model: model.name)
def test_as_good_as_from_all_starts(model: Model) -> None:
    search = Warm().of("all")
    for n in range(10_000, 40_000, 3000):
        data = series(n)
        assert search(data, model).nll[0] == pytest.approx(fit(data, model).nll[0], abs=0.05)


def test_when_the_grid_is_searched_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []

    def noted(data: Binned, model: Model, extra=None, warm=None):  # type: ignore[no-untyped-def]
        asked.append(warm is None)
        found = fit(data, model, extra, warm)
        return found._replace(theta=found.theta * 0 + edge)

    monkeypatch.setattr(warm_fits, "fit", noted)
    edge, memory = 0.5, Warm()
    for n in (10_000, 12_000, 19_000, 21_000, 22_000):
        memory.of("all")(series(n), FULL)
    assert asked == [True, False, False, True, False]
    memory.of("clean")(series(22_000), FULL)
    memory.forget()
    memory.of("all")(series(22_000), FULL)
    assert asked[5:] == [True, True]
    asked.clear()
    edge, memory = 15.0, Warm()
    for n in (10_000, 10_500, 12_000):
        memory.of("all")(series(n), FULL)
    assert asked == [True, False, True]


def test_sets_of_ordinates_do_not_mix() -> None:
    memory = Warm()
    one = memory.of("all")(series(20_000), FULL)
    other = memory.of("clean")(binned(periodogram(white(20_000, 1, 5)[0], H)), FULL)
    assert not np.allclose(one.theta, other.theta)
    assert memory.of("all")(series(20_000), FULL).theta == pytest.approx(one.theta, abs=1e-3)


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
        for axis, alone in cold.fit(curves=False, fresh=True).items():
            for name in FIGURES:
                ours, whole = getattr(found[axis], name), getattr(alone, name)
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
