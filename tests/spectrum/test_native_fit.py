"""Native fits and intervals beside slow ones that share only the models with them; slopes; hostile data."""

from collections.abc import Callable

import numpy as np
import pytest
from fltea.noise import spectra as spectrum
from fltea.spectrum import models
from fltea.spectrum.arfima import ARFIMA
from fltea.spectrum.low_pass import LOW_PASS
from fltea.spectrum.periodogram import Binned, binned, used_ordinates
from fltea.spectrum.profile import JUMPS, below_by_chance, critical_value, fractional_fit
from fltea.spectrum.relaxations import sum_of
from fltea.spectrum.rising import RISING
from fltea.spectrum.whittle import Fit, Model, fit, slopes
from hypothesis import given, settings
from hypothesis import strategies as st
from identify_support import H, drawn
from slow_fit import slow_fit
from slow_profile import slow_intervals
from tiers import slow

Shape = Callable[[np.ndarray], np.ndarray]

FRACTIONAL = [(0.1, -0.5), (0.3, -1.5), (0.4, -1.0), (0.6, -3.0), (0.8, -1.0), (0.8, -10.0), (1.3, -5.0)]


def noises() -> dict[str, Shape]:
    """White noise, fractional noise from a third of the white noise's power to nearly all, and the rivals."""

    def fractional(alpha: float, f: float, s2: float) -> Shape:
        return lambda lam: s2 * spectrum.fractional(lam, alpha, H**alpha * f) + 1

    found: dict[str, Shape] = {"white": np.ones_like}
    for alpha, f in FRACTIONAL:
        for s2 in (0.3, 3.0, 100.0):
            found[f"fractional {alpha} {f} {s2}"] = fractional(alpha, f, s2)
    found["ar1"] = lambda lam: spectrum.ar1(lam, 0.95) + 2
    found["ar2"] = lambda lam: spectrum.ar2(lam, 1.9 * np.cos(1.5), -(0.95**2)) + 3
    found["two ar1"] = lambda lam: spectrum.ar1(lam, 0.995) + 16 * spectrum.ar1(lam, 0.5) + 1
    return found


def series(shape: Shape, n: int, seeds: range) -> Binned:
    lam = 2 * np.pi * used_ordinates(n, H) / n
    several = [binned(drawn(shape(lam), lam, n, seed)) for seed in seeds]
    return several[0]._replace(power=np.concatenate([one.power for one in several]))


def nested(data: Binned, model: Model) -> np.ndarray | None:
    """The best AR(1) in the coordinates of what contains it, as the callers of `fit` give it."""
    ar1 = fit(data, models.AR1).theta
    pole, part = np.hsplit(ar1, 2)
    if model is models.UP_TO_ONE:
        phi, weight = models.ar1_parameters(ar1)
        return models.coordinates(1.0, phi - 1, weight)[:, np.newaxis]
    if model is models.AR2:
        return np.stack([pole, 0 * pole, part], axis=-1)
    if model is models.TWO_AR1:
        return np.stack([pole, 0 * pole, part, models.logit(0 * part)], axis=-1)
    return None


@pytest.mark.parametrize("n", [3_000, slow(60_000)])
@pytest.mark.parametrize(
    "model",
    [models.AR1, models.FULL, models.UP_TO_ONE, models.AR2, models.TWO_AR1],
    ids=lambda m: f"{m.name} {m.highest_order:g}",
)
def test_as_good_as_the_slow_fit(model: Model, n: int) -> None:
    """Of 50 series -log L is hardly ever higher by 0.05, never by 0.5 where the slow fit is repeatable."""
    worse = []
    for shape in noises().values():
        data = series(shape, n, range(2))
        start = nested(data, model)
        slow = slow_fit(data, model, start)
        found = fit(data, model, start)
        worse.append(found.nll - slow.nll)
        for i in np.flatnonzero(worse[-1] > 0.5):  # a lucky simplex is none to be measured by
            one = data._replace(power=1.0001 * data.power[i : i + 1])
            again = slow_fit(one, model).nll[0] - np.log(1.0001) * data.counts.sum()
            assert again > slow.nll[i] + 0.4
    assert np.mean(np.concatenate(worse) <= 0.05) >= 0.97


@pytest.mark.parametrize("n", [3_000, 60_000])
def test_warm_start_ends_where_the_cold_one_did(n: int) -> None:
    """From the fit to slightly different data, as the live fit begins. White noise has too many maxima."""
    worse = []
    for name, shape in noises().items():
        data = series(shape, n, range(2))
        changed = np.random.default_rng(1).uniform(0.99, 1.01, data.power.shape)
        for model in (models.FULL, models.AR1, models.AR2, models.TWO_AR1):
            before = fit(data._replace(power=data.power * changed), model).theta
            if name != "white":
                cold = fit(data, model, before[:, np.newaxis])
                worse.append(fit(data, model, warm=before).nll - cold.nll)
    assert np.mean(np.concatenate(worse) <= 0.1) >= 0.97


@pytest.mark.slow
@pytest.mark.parametrize("n", [3_000, 60_000])
def test_intervals_as_the_slow_ones(n: int) -> None:
    """Ends agree within a tenth of the interval, or the native search has found what the slow one did not.

    That is shown by the likelihood: a wider interval has at its end a spectrum that is good enough.
    """
    narrower, all_of_them = [], 0
    for name, shape in noises().items():
        if name == "white" or not name.endswith("3.0" if n == 3_000 else "0.3"):
            continue
        data = series(shape, n, range(1))
        found = fit(data, models.FULL)
        native, slow = fractional_fit(data, found, H), slow_intervals(data, found, H)
        for key in ("F", "alpha", "g", "f", "s2", "R"):
            mine, other = getattr(native, key), getattr(slow, key)
            all_of_them += 1
            if not mine.defined:
                continue
            if not other.defined:
                narrower.append((name, key))
                continue
            tenth = 0.1 * (other.high - other.low)
            if mine.low > other.low + tenth or mine.high < other.high - tenth:
                narrower.append((name, key))
            if key in ("alpha", "F", "f"):
                check_that_it_is_that_wide(
                    data, found, key, mine.low if mine.low < other.low - tenth else None
                )
                check_that_it_is_that_wide(
                    data, found, key, mine.high if mine.high > other.high + tenth else None
                )
    assert all_of_them >= 40
    assert len(narrower) <= 0.03 * all_of_them, narrower


def check_that_it_is_that_wide(data: Binned, found: Fit, key: str, end: float | None) -> None:
    if end is None or (key == "f" and end == 0):
        return
    held = models.held(key, end, H)
    best = min(slow_fit(data, held), fit(data, held), key=lambda one: one.nll[0])
    no_white = bool(np.exp(-best.theta[0, -1]) < 1.1e-3)
    critical = critical_value(key, no_white) + (below_by_chance(data, found) if key in JUMPS else 0)
    assert 2 * (best.nll[0] - found.nll[0]) <= critical + 0.2


SUMS = [sum_of(count) for count in (1, 2, 3, 6)]
FILTERS = [*LOW_PASS, ARFIMA, RISING]
HELD = [models.held("alpha", 0.7), models.held("g", -0.3), models.held("f", -3.0, H), models.held("F", 0.3)]


@settings(max_examples=60)
@given(
    st.sampled_from([models.FULL, models.AR1, models.AR2, models.TWO_AR1, *HELD, *SUMS, *FILTERS]),
    st.integers(0, 1_000),
    st.lists(st.floats(0.05, 1.6), min_size=12, max_size=12),
)
def test_slopes_are_differences(model: Model, seed: int, coordinates: list[float]) -> None:
    data = series(lambda lam: 1 + 1 / lam, 400, range(seed, seed + 1))
    theta = np.array([coordinates[: model.starts.shape[1]]])
    if model.held.name == "F":
        theta[0, 0] -= 1.5
    elif model.held.name and model.name == "fractional":
        theta[0, 0] = 0.2 + theta[0, 0]
    found = slopes(data, model, theta)
    step = 1e-5
    for i in range(theta.shape[1]):
        by = np.zeros_like(theta)
        by[0, i] = step
        up, down = (slopes(data, model, theta + sign * by).nll[0] for sign in (1, -1))
        assert found.gradient[0, i] == pytest.approx((up - down) / (2 * step), rel=1e-3, abs=1e-3)
    # The same -log L as in numpy, and an information that can be one.
    shape = model.shape(data.lam, theta)[0]
    m = data.counts.sum()
    scale = (data.power[0] / shape) @ data.counts / m
    assert found.nll[0] == pytest.approx(data.counts @ np.log(shape) + m * np.log(scale) + m, rel=1e-9)
    assert np.linalg.eigvalsh(found.information[0]).min() >= -1e-9 * m


def test_information_is_the_spread_of_the_fits() -> None:
    """The deviation of the order over 60 series is what the information at a fit says."""
    data = series(lambda lam: spectrum.fractional(lam, 0.8, -(H**0.8)) + 0.3, 20_000, range(60))
    found = fit(data, models.FULL)
    expected = np.sqrt(np.linalg.inv(slopes(data, models.FULL, found.theta).information)[:, 0, 0])
    assert np.std(found.theta[:, 0]) == pytest.approx(np.median(expected), rel=0.3)


def good() -> Binned:
    return series(lambda lam: 1 + 1 / lam, 1_000, range(2))


def broken() -> dict[str, Binned]:
    data = good()
    nan, infinite, negative = (data.power.copy() for _ in range(3))
    nan[1, 3], infinite[0, 0], negative[1, 1] = np.nan, np.inf, -1.0
    return {
        "nan in the power": data._replace(power=nan),
        "infinite power": data._replace(power=infinite),
        "negative power": data._replace(power=negative),
        "no power": data._replace(power=data.power * [[1.0], [0.0]]),
        "nothing counted": data._replace(counts=0 * data.counts),
        "negative counts": data._replace(counts=-data.counts),
        "nan in the counts": data._replace(counts=data.counts * np.nan),
        "one bin": Binned(data.lam[:1], data.counts[:1], data.power[:, :1]),
        "no bin": Binned(data.lam[:0], data.counts[:0], data.power[:, :0]),
        "falling frequencies": data._replace(lam=data.lam[::-1]),
        "frequencies from 0": data._replace(lam=data.lam - data.lam[0]),
        "frequencies beyond pi": data._replace(lam=2 * data.lam),
        "fewer counts than bins": data._replace(counts=data.counts[1:]),
    }


@pytest.mark.parametrize("what", broken())
def test_what_cannot_be_fitted_is_refused(what: str) -> None:
    data = broken()[what]
    found = fit(good(), models.FULL)
    for model in (models.WHITE, models.FULL, models.AR1, models.AR2, models.TWO_AR1):
        with pytest.raises(ValueError, match=r"power|count|bin|lam|number"):
            fit(data, model)
    row = 0 if what == "infinite power" else 1
    with pytest.raises(ValueError, match=r"power|count|bin|lam|number"):
        fractional_fit(data._replace(power=data.power[row : row + 1]), found, H)


@pytest.mark.parametrize(
    "held",
    [models.held("alpha", 2.5), models.held("g", 0.1), models.held("f", np.nan, H), models.held("g", 0.0)],
)
def test_what_cannot_be_held_is_refused(held: Model) -> None:
    with pytest.raises(ValueError, match="held"):
        fit(good(), held)


def test_starts_of_a_wrong_shape_are_refused() -> None:
    data = good()
    for warm in (np.zeros((1, 3)), np.zeros((2, 2)), np.full((2, 3), np.nan)):
        with pytest.raises(ValueError, match="starts"):
            fit(data, models.FULL, warm=warm)
    with pytest.raises(ValueError, match="starts"):
        fit(data, models.FULL, np.zeros((2, 1, 2)))


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(0, 1e6), st.floats(0, 1e12)), min_size=2, max_size=40),
    st.sampled_from([models.WHITE, models.FULL, models.AR1, models.AR2, models.TWO_AR1]),
)
def test_any_spectrum_is_fitted_or_refused(bins: list[tuple[float, float]], model: Model) -> None:
    counts, power = np.array(bins).T
    data = Binned(np.linspace(1e-5, np.pi, len(bins)), counts, power[np.newaxis])
    if counts.sum() == 0 or not counts @ power > 1e-90 * counts.sum():
        return
    found = fit(data, model)
    assert np.isfinite(found.nll).all()
    assert np.isfinite(found.theta).all()
    assert found.scale[0] > 0
    if model is models.FULL:
        interval = fractional_fit(data, found, H).F
        assert interval.low is None or interval.low <= interval.value <= interval.high


def test_weights_need_not_be_whole_numbers() -> None:
    """A line of weight 2.5 counts as two and a half."""
    data = good()
    some = data._replace(counts=data.counts * 2.5)
    a, b = fit(data, models.FULL), fit(some, models.FULL)
    np.testing.assert_allclose(b.nll, 2.5 * a.nll, rtol=1e-6)
