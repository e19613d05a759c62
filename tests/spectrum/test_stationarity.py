"""The test of stationarity accepts noises that stay the same, and rejects noises that change."""

from collections.abc import Callable

import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.records.arrays import Array
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.spectral import examine
from fltea.spectrum.stationarity import Change, find_change
from fltea.spectrum.verdict import decide

from tests.rig.identify_support import H, ar, long_recursion, white
from tests.rig.numpy_octaves import fed
from tests.rig.tiers import slow
from tools.validation.power import WHITE

LEVEL = 0.01


def change(y: Array, level: float = LEVEL) -> Change | None:
    return find_change(fed(y).cells(0, H), H, level)


NOISES: dict[str, Callable[[int, np.random.Generator], Array]] = WHITE | {
    "a relaxation": lambda n, rng: ar((0.99,), n, 1, int(rng.integers(1 << 30)))[0],
    "fractional": lambda n, rng: long_recursion(0.6, -0.02, n, int(rng.integers(1 << 30))),
    "random walk": lambda n, rng: rng.standard_normal(n).cumsum(),
}


@pytest.mark.parametrize("n", [3000, slow(20_000)])
@pytest.mark.parametrize("noise", NOISES)
def test_noises_that_stay_the_same(noise: str, n: int) -> None:
    """At the significance level 1 %, at most 3 of 50 series are rejected."""
    rng = np.random.default_rng(n)
    assert sum(change(NOISES[noise](n, rng)) is not None for _ in range(50)) <= 3


@pytest.mark.parametrize("n", [3000, 20_000, 60_000])
def test_power_that_doubles(n: int) -> None:
    y = white(n, 1, 1)[0]
    y[n // 2 :] *= np.sqrt(2)
    found = change(y, ANYTIME_LEVEL / 5)
    assert found.ratio == pytest.approx(2, rel=0.25)
    assert found.at_s == pytest.approx(n * H / 2, rel=0.15)
    assert found.share > 0.8


def test_an_order_that_changes() -> None:
    n = 20_000
    y = np.concatenate([long_recursion(0.4, -0.158, n // 2, 1), long_recursion(0.8, -0.025, n // 2, 2)])
    seen = examined(y + white(n, 1, 3)[0], H)
    verdict = decide(seen.evidence)
    assert verdict.kind == "not stationary"
    assert "live.memory" in verdict.text
    assert "around 1" in verdict.text
    assert [rule.answer for rule in verdict.rules] == [True]


def test_power_that_goes_up_and_down() -> None:
    n = 60_000
    y = white(n, 1, 2)[0] * np.exp(0.4 * np.sin(2 * np.pi * 3 * np.arange(n) / n))
    found = change(y)
    assert found.share < 0.6
    assert "went up and down" in decide(examined(y, H).evidence).text


def swinging(n: int, period_s: float, ratio: float, seed: int, *, regular: bool = True) -> Array:
    """Return white noise whose standard deviation is `ratio` times as large in one half of each period."""
    rng = np.random.default_rng(seed)
    if regular:
        up = (np.arange(n) * H + rng.uniform(0, period_s)) // (period_s / 2) % 2
    else:
        up = np.cumsum(rng.random(n) < 2 * H / period_s) % 2.0
    return rng.standard_normal(n) * np.where(up, ratio, 1.0)


@pytest.mark.parametrize("ratio", [1.5, 2.0])
@pytest.mark.parametrize("period_s", [6.0, 10.0, 40.0, 200.0])
def test_more_samples_never_say_less(period_s: float, ratio: float) -> None:
    y = swinging(200_000, period_s, ratio, 11)
    assert all(change(y[:n], 1e-3) is not None for n in (20_000, 60_000, 200_000))
    assert change(y[:60_000], ANYTIME_LEVEL / 50) is not None, "live, too"


def test_the_fastest_swings() -> None:
    """Swings of the noise's level are detected even if they are as short as the blocks of the spectrum, 2.56
    s.
    """
    for ratio in (1.5, 2.0):
        y = swinging(200_000, 4.0, ratio, 12)
        assert all(change(y[:n], 1e-3) is not None for n in (60_000, 200_000))


@pytest.mark.parametrize(("period_s", "n"), [(4.0, 60_000), (20.0, 20_000), (40.0, 60_000)])
def test_a_period_is_told(period_s: float, n: int) -> None:
    evidence = examined(swinging(n, period_s, 2.0, 13), H).evidence
    assert evidence.change.period_s == pytest.approx(period_s, rel=0.01)
    assert evidence.change.size == pytest.approx(4, rel=0.15)
    assert f"every {period_s:.0f} s" in decide(evidence).text


@pytest.mark.parametrize("seed", range(3))
def test_what_swings_at_random_has_no_period(seed: int) -> None:
    evidence = examined(swinging(60_000, 20.0, 2.0, seed, regular=False), H).evidence
    assert evidence.change.period_s is None
    assert "went up and down" in decide(evidence).text
    assert "s or so" in decide(evidence).text


def test_pieces_of_a_record_say_together_what_it_says() -> None:
    y = swinging(60_000, 40.0, 1.5, 14)
    total = fed(y[:7_000])
    for begin, end in ((7_000, 20_000), (20_000, 41_000), (41_000, 60_000)):
        total.merge(fed(y[begin:end]))
    found = find_change(total.cells(0, H), H, 1e-3)
    assert found is not None
    assert not found.is_step


def test_swings_are_forgotten_with_the_rest() -> None:
    octaves = Octaves(1, 20_000.0)
    octaves.add(swinging(40_000, 20.0, 2.0, 15)[:, np.newaxis])
    assert find_change(octaves.cells(0, H), H, 1e-3) is not None
    octaves.add(white(80_000, 1, 16).T)
    assert find_change(octaves.cells(0, H), H, 1e-3) is None


def test_a_small_change_does_not_matter() -> None:
    """A small change of the noise's level is accepted, since it is significant but of no practical
    importance.
    """
    n = 200_000
    y = white(n, 1, 4)[0]
    y[n // 2 :] *= np.sqrt(1.15)
    assert change(y) is None


def test_what_is_left_out_is_not_looked_at() -> None:
    n = 20_000
    t = np.arange(n) * H
    y = white(n, 1, 5)[0] + np.where(t > 100, 1.0, 0.0) * np.sin(2 * np.pi * 30 * t)
    assert change(y) is not None
    assert decide(examined(y, H, notch=((29.0, 31.0),)).evidence).kind == "white"


def test_a_sharp_resonance_does_not_change() -> None:
    """A sharp resonance rings on over several blocks of the spectrum, so that the powers of neighbouring
    blocks depend on each other.

    Without a correction for this dependence, one in four records with a sharp resonance would be called not
    stationary.
    """
    phi = 2 * 0.995 * np.cos(1.97), -(0.995**2)
    kinds = [decide(examined(y, H).evidence).kind for y in ar(phi, 6000, 20, 1)]
    assert kinds == ["resonance"] * 20


def test_too_few_blocks_say_nothing() -> None:
    assert change(white(300, 1, 6)[0]) is None
    assert find_change([], H, LEVEL) is None
    seen = examine(fed(white(3000, 1, 7)[0]).periodogram(0, H), 30.0, 3000)
    assert seen.evidence.change is None
