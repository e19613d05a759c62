"""Fits of noise models are compared with slow fits by scipy, and intervals with slow profiles.

The model search is tested, too.
"""

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.spectrum.candidate_models import CandidateModels, FittedModel, native, order_in_white, order_of
from fltea.spectrum.estimated import estimated
from fltea.spectrum.intervals import CRITICAL
from fltea.spectrum.order_fit import order_fit
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.reading import read
from scipy.optimize import minimize

from tests.rig.identify_support import H
from tests.rig.model_support import bins, closed_form

Parts = Sequence[p.Part]


def order(alpha: float, corner_hz: float, power: float) -> p.Order:
    """Return the part "order" of a noise model, with this corner frequency and the density `power` below the
    corner.
    """
    g = -((2 * math.pi * corner_hz * H) ** alpha)
    return p.Order(alpha, g / H**alpha, power * g**2 / H ** (2 * alpha))


NOISES: dict[str, Parts] = {
    "relaxation": (p.White(1.0), p.Relaxation(1.0, 0.3)),
    "two relaxations": (p.White(1.0), p.Relaxation(1.0, 0.05), p.Relaxation(0.7, 2.0)),
    "walk": (p.White(1.0), p.Walk(0.3)),
    "quantisation": (p.White(1.0), p.Quantisation(0.01)),
    "resonance": (p.White(1.0), p.Resonance(8.0, 12.0, 2.0)),
    "low-pass": (p.White(1.0), p.LowPass(15.0, 4.0), p.Floor(0.05)),
    "high-pass": (p.White(1.0), p.HighPass(0.3, 1.5)),
    "high-pass, relaxation": (p.White(1.0), p.Relaxation(2.0, 0.1), p.HighPass(0.1, 2.0)),
    "notch": (p.White(1.0), p.Notch(25.0, 5.0)),
    "order": (p.White(1.0), order(0.5, 0.3, 60.0)),
}


def negative_log_likelihood(parts: Parts, data: Binned) -> float:
    spectrum = closed_form(parts, data.lam, H)
    return float(data.counts @ (np.log(spectrum) + data.power[0] / spectrum))


def at(parts: Parts, eta: Sequence[float]) -> list[p.Part]:
    found, begin = [], 0
    for part in parts:
        free = p.free_of(part.code)
        found.append(p.part_of(part.code, eta[begin : begin + free], H))
        begin += free
    return found


def slow_fit(parts: Parts, data: Binned, held: tuple[int, float] | None = None) -> float:
    """Return the negative log-likelihood of the best fit by scipy's simplex method, which starts at the true
    parameters.

    `held`: index of a free parameter that is not fitted, and its fixed value.
    """
    start = np.concatenate([part.eta(H) for part in parts])
    free = np.ones(len(start), dtype=bool)
    if held is not None:
        start[held[0]], free[held[0]] = held[1], False

    def objective(some: np.ndarray) -> float:
        eta = start.copy()
        eta[free] = some
        with np.errstate(all="ignore"):
            try:
                value = negative_log_likelihood(at(parts, eta.tolist()), data)
            except (ValueError, OverflowError):
                return 1e12
        return value if math.isfinite(value) else 1e12

    options = {"maxiter": 4000, "maxfev": 8000, "xatol": 1e-7, "fatol": 1e-7, "adaptive": True}
    found = minimize(objective, start[free], method="Nelder-Mead", options=options)
    found = minimize(objective, found.x, method="Nelder-Mead", options=options)
    return float(found.fun)


def fitted(parts: Parts, data: Binned, n: int) -> tuple[CandidateModels, FittedModel]:
    f = CandidateModels(data, H, n)
    codes = [part.code for part in parts]
    eta, nll = f.native.fit(codes, [one for part in parts for one in part.eta(H)])
    return f, FittedModel(tuple(codes), tuple(eta), nll)


@pytest.mark.parametrize("name", [name for name in NOISES if name != "notch"])
def test_as_good_as_the_slow_fit(name: str) -> None:
    """The native fit is as good as the slow fit. The noise with a notch is not compared.

    For a notch, the native fit averages the model's spectrum over each bin. Near the notch's frequency, where
    the spectrum is 0, the average differs from the value at the bin's centre, which the slow fit takes.
    """
    for seed in range(2):
        data = bins(NOISES[name], 20_000, H, seed)
        _, found = fitted(NOISES[name], data, 0)
        assert found.nll == pytest.approx(slow_fit(NOISES[name], data), abs=0.02)


@pytest.mark.parametrize("name", ["relaxation", "quantisation", "resonance"])
def test_intervals_end_where_the_slow_profile_falls(name: str) -> None:
    data = bins(NOISES[name], 20_000, H, 5)
    f, model = fitted(NOISES[name], data, 0)
    part = estimated(f, model)[1]
    best = p.part_of(model.codes[1], model.eta[1:], H)
    for k, (field, interval) in enumerate(part.values.items()):
        for end in (interval.low, interval.high):
            assert end is not None
            if field == "width_hz":
                # the free parameter is width / frequency here, and an end of the width's interval is not an
                # end of the interval of this ratio
                continue
            at_end = msgspec.structs.replace(best, **{field: end}).eta(H)[k]
            fall = 2 * (slow_fit(NOISES[name], data, (1 + k, at_end)) - model.nll)
            assert fall == pytest.approx(CRITICAL, abs=0.15)


def test_the_order_s_interval_is_that_of_the_slow_profile() -> None:
    data = bins(NOISES["order"], 60_000, H, 1)
    f, model = fitted(NOISES["order"], data, 0)
    found = order_fit(f, model)
    for end in (found.alpha.low, found.alpha.high):
        assert end is not None
        fall = 2 * (slow_fit(NOISES["order"], data, (1, end)) - model.nll)
        assert fall == pytest.approx(CRITICAL, abs=0.15)
    assert found.F.value is not None
    assert found.F.value == pytest.approx(found.alpha.value + H**found.alpha.value * found.f.value)
    for interval in (found.alpha, found.f, found.F, found.s2, found.R):
        assert interval.low < interval.value < interval.high


@pytest.mark.parametrize("n", [3_000, 60_000])
def test_a_later_look_finds_the_ends_that_a_first_one_finds(n: int) -> None:
    first = CandidateModels(bins(NOISES["order"], n, H, 1), H, n)
    assert first.order is not None
    order_fit(first, first.order)
    more = bins(NOISES["order"], n, H, 2)
    power = (first.data.power + 0.05 * more.power) / 1.05
    data = more._replace(counts=1.05 * more.counts, power=power)
    later, fresh = CandidateModels(data, H, n, first.fits), CandidateModels(data, H, n)
    assert later.order is not None
    assert fresh.order is not None
    found, anew = order_fit(later, later.order), order_fit(fresh, fresh.order)
    for name in ("alpha", "F", "s2", "R"):
        one, other = getattr(found, name), getattr(anew, name)
        assert one.low == pytest.approx(other.low, abs=0.02 * (other.high - other.low))
        assert one.high == pytest.approx(other.high, abs=0.02 * (other.high - other.low))


def test_a_parameter_that_is_as_good_as_not_there_stops_no_fit() -> None:
    parts = (p.White(1.0), p.Order(0.5, -1e-5, 0.06 / H))
    f, best = fitted(parts, bins(parts, 1_000_000, H, None), 0)
    away = [best.eta[0], best.eta[1] + 0.05, -16.0, best.eta[3]]
    _, nll = f.native.fit(list(best.codes), away)
    assert nll == pytest.approx(best.nll, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["relaxation", "two relaxations", "walk", "quantisation", "resonance"])
def test_intervals_hold_the_truth(name: str) -> None:
    """The 95 % intervals of all parameters contain the true values in 95 % of the cases. The tolerance of 8.5
    % is three standard deviations of a binomial for 60 series.
    """
    held, count = 0, 0
    for seed in range(60):
        f, model = fitted(NOISES[name], bins(NOISES[name], 20_000, H, seed), 0)
        for truth, part in zip(NOISES[name], estimated(f, model), strict=True):
            for field, interval in part.values.items():
                value = getattr(truth, field)
                below = interval.low is None or interval.low <= value
                held += below and (interval.high is None or value <= interval.high)
                count += 1
    assert 0.9 < held / count < 0.99


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("power", [10.0, 100.0])
def test_intervals_of_an_order_hold_the_truth(alpha: float, power: float) -> None:
    parts = (p.White(1.0), order(alpha, 0.3, power))
    held: dict[str, list[bool]] = {}
    for seed in range(60):
        f, model = fitted(parts, bins(parts, 30_000, H, seed), 0)
        found = order_fit(f, model)
        g = H**alpha * parts[1].f
        truths = {
            "alpha": alpha,
            "f": parts[1].f,
            "F": g + alpha,
            "s2": parts[1].Q * H ** (2 * alpha),
            "R": 1.0,
        }
        for field, value in truths.items():
            low, high = getattr(found, field).low, getattr(found, field).high
            if low is not None and high is not None:
                held.setdefault(field, []).append(low <= value <= high)
    for field, several in held.items():
        assert len(several) < 20 or np.mean(several) > 0.86, field


@pytest.mark.parametrize("name", NOISES)
def test_of_exact_spectra_the_search_finds_the_parts(name: str) -> None:
    f = CandidateModels(bins(NOISES[name], 200_000, H, None), H, 0)
    best = f.ordered if name == "order" else f.plain
    assert {type(part) for part in best.parts(H)} == {type(part) for part in NOISES[name]}
    assert (f.lead > 6) == (name == "order")


def test_orders_that_two_relaxations_describe_are_none() -> None:
    f = CandidateModels(bins(NOISES["two relaxations"], 100_000, H, 3), H, 0)
    assert f.lead < 0
    assert f.gain(f.rich) >= f.gain(f.plain) - 1e-6


def test_fitted_again_it_stays_and_follows() -> None:
    first = CandidateModels(bins(NOISES["order"], 60_000, H, 3), H, 0)
    same = CandidateModels(first.data, H, 0, first.fits)
    assert same.plain.nll == pytest.approx(first.plain.nll, abs=1e-2)
    more = CandidateModels(bins(NOISES["order"], 64_000, H, 4), H, 0, first.fits)
    assert more.ordered.codes == first.ordered.codes if first.ordered else False
    found, fresh = order_of(more.ordered), order_of(CandidateModels(more.data, H, 0).ordered)
    assert found == pytest.approx(fresh, abs=0.01)


@pytest.mark.parametrize("alpha", [0.5, 1.0, 1.5, 1.9])
def test_the_order_in_white_noise_is_up_to_two(alpha: float) -> None:
    z = np.exp(-1j * (data := bins([p.White(1.0)], 100_000, H, 1)).lam)
    power = data.power * (1 + 0.1 / np.abs((1 - z) ** alpha + 0.02 * z) ** 2)
    found = order_in_white(native(data._replace(power=power), H, 0))
    assert found.eta[1] == pytest.approx(alpha, abs=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d._replace(power=0 * d.power), "no noise"),
        (lambda d: d._replace(counts=0 * d.counts), "nothing to fit"),
        (lambda d: d._replace(power=d.power * math.nan), "power must"),
        (lambda d: d._replace(lam=d.lam[::-1]), "lam must increase"),
        (lambda d: d._replace(counts=-d.counts), "counts must"),
        (lambda d: Binned(d.lam[:1], d.counts[:1], d.power[:, :1]), "2 or more"),
    ],
)
def test_what_cannot_be_fitted_is_refused(change: Callable[[Binned], Binned], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CandidateModels(change(bins([p.White(1.0)], 5000, H, 1)), H, 0)


@pytest.mark.parametrize("codes", [[], [1], [0, p.CODES.index(p.Mean)], [0, 99], [0, 200], [0] + [3] * 9])
def test_what_is_no_model_is_refused(codes: list[int]) -> None:
    fits = native(bins([p.White(1.0)], 5000, H, 1), H, 0)
    with pytest.raises(ValueError, match=r"model|part|eta"):
        fits.fit(codes, [0.0] * 3)


def test_what_is_left_at_the_zero_of_a_mean_is_no_rise() -> None:
    f = CandidateModels(bins([p.White(1.0), p.Mean(4), p.Floor(1e-3)], 200_000, H, 1), H, 0)
    mean_of_4, alternating = p.MEAN_FROM + 4, p.CODES.index(p.Alternating)
    f.plain = FittedModel((0, mean_of_4, alternating), (0.0, 2.2, -11.5), f.plain.nll)
    found = read(f, 0.01)
    assert found.low_pass is not None
    assert not found.rises


@pytest.mark.parametrize("kind", [p.Order, p.Arfima])
def test_an_order_behind_a_mean_of_samples_has_intervals(kind: type[p.Part]) -> None:
    """Noise of fractional order has intervals even if the filter `Mean` is before it in the list of parts.

    `Mean` has no free parameters, so it must not count when the index of the order's first parameter is
    computed.
    """
    ordered = order(0.5, 0.3, 60.0) if kind is p.Order else p.Arfima(0.4, 0.8, 0.5)
    parts = (p.White(1.0), p.Mean(4), ordered)
    f, model = fitted(parts, bins(parts, 20_000, H, 1), 0)
    found = order_fit(f, model)
    assert found.alpha.value is not None
    assert found.s2.low < found.s2.value < found.s2.high
