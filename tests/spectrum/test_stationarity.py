"""The test of stationarity: silent on noises that stay the same, loud on those that do not."""

from collections.abc import Callable

import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.records.arrays import Array
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.spectral import examine
from fltea.spectrum.stationarity import Change, find_change
from fltea.spectrum.verdict import decide
from identify_support import H, ar, long_recursion, white
from numpy_octaves import fed
from tiers import slow

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
    """At 1 %, of 50 series."""
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


def test_a_small_change_does_not_matter() -> None:
    """Significant, but of no practical importance."""
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
    """It fills whole blocks alike: without care one in four would be called so."""
    phi = 2 * 0.995 * np.cos(1.97), -(0.995**2)
    kinds = [decide(examined(y, H).evidence).kind for y in ar(phi, 6000, 20, 1)]
    assert kinds == ["resonance"] * 20


def test_too_few_blocks_say_nothing() -> None:
    assert change(white(300, 1, 6)[0]) is None
    assert find_change([], H, LEVEL) is None
    seen = examine(fed(white(3000, 1, 7)[0]).periodogram(0, H), 30.0, 3000)
    assert seen.evidence.change is None
