"""Fits that begin at the last answer: as good as those from all starts."""

import numpy as np
import pytest
from fltea.spectrum import warm as warm_fits
from fltea.spectrum.models import AR2, FULL, TWO_AR1
from fltea.spectrum.periodogram import Binned, binned, periodogram
from fltea.spectrum.warm import Warm
from fltea.spectrum.whittle import Model, fit
from identify_support import H, long_recursion, white


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
