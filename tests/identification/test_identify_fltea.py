"""Tests of the algorithm FLTEA on a recording. Its figures equal those of the daemon. Its estimates for
shuffled copies of the recording are tested, too, and so are the figures that say whether innovations are
white.
"""

from typing import Literal

import msgspec
import numpy as np
import pytest
from fltea.estimator.bank import Bank
from fltea.identification.fltea_fit import FlteaAxis, fltea_fits
from fltea.identification.gaps import Gaps, no_gaps
from fltea.identification.shuffled import (
    GROUP_BYTES,
    LEAST_LANES,
    LONGEST,
    MOST_LANES,
    ShuffledBand,
    estimate,
    groups,
    shuffled_band,
)
from fltea.settings.estimator import AccelConfig, EstimatorConfig
from fltea.spectrum.innovation_whiteness import innovations
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.identify_support import H, ar, long_recursion, white
from tests.rig.one_fltea import fltea_fit

LSB = 1 / 16.4
Variant = Literal["joint", "triple"]
Guard = Literal["off", "faithful", "consistent"]


def config(**more: object) -> EstimatorConfig:
    return EstimatorConfig(startup=100, **more)  # type: ignore[arg-type]


def counts(seed: int, n: int = 900) -> np.ndarray:
    """Return the noise of a sensor with an offset, rounded to whole counts."""
    return np.rint((1.7 + 0.14 * white(n, 1, seed)[0]) / LSB) * LSB


def disturbed(stop: int) -> np.ndarray:
    """Return the samples of `counts(1)`, with violent motion added from sample 300 to `stop`.

    The guard intervenes, and the supervisor rejects the estimate.
    """
    y = counts(1)
    y[300:stop] += 30 * np.random.default_rng(1).choice([-1, 1], stop - 300)
    return y


SETTINGS: list[tuple[Variant, Guard, dict[str, object]]] = [
    ("joint", "consistent", {}),
    ("triple", "consistent", {}),
    ("triple", "off", {}),
    ("joint", "consistent", {"bias": 1.7, "R": 0.02}),
    ("joint", "consistent", {"memory": "direct"}),
    ("triple", "off", {"R": 0.002}),  # in this case, the estimate runs away, and FLTEA starts over
]


def check_equality(y: np.ndarray, settings: EstimatorConfig) -> tuple[bool, int]:
    live = Bank(("x",), settings, H, LSB)
    live.run(y[: settings.startup_needed, np.newaxis])
    last = live.run(y[settings.startup_needed :, np.newaxis])
    found, _ = fltea_fit(y, H, settings, LSB)
    assert found.valid == last.valid[-1, 0]
    if found.valid:
        assert (found.alpha, found.alpha_std) == (last.alpha[-1, 0], last.alpha_std[-1, 0])
        assert (found.f, found.f_std) == (last.f[-1, 0], last.f_std[-1, 0])
    else:
        assert found.alpha is None
        assert found.f is None
    assert (found.bias, found.R) == (live.baseline.bias_dps[0], live.baseline.R[0])
    assert found.restarts == live.restarts["x"]
    assert found.interventions == live.interventions["x"]
    assert found.R_from == ("start-up window" if settings.R == "auto" else "setting")
    assert found.startup_samples == settings.startup_needed
    return found.valid, found.restarts


@pytest.mark.parametrize(("variant", "guard", "more"), SETTINGS)
def test_equals_the_daemon_to_the_bit(variant: Variant, guard: Guard, more: dict[str, object]) -> None:
    valid, restarts = check_equality(counts(1), config(variant=variant, guard=guard, **more))
    assert valid
    assert (restarts > 0) == (more.get("R") == 0.002)


@pytest.mark.parametrize(("stop", "outcome"), [(900, (False, 0)), (500, (True, 1)), (310, (True, 0))])
def test_the_supervisor_has_its_say(stop: int, outcome: tuple[bool, int]) -> None:
    assert check_equality(disturbed(stop), config()) == outcome


def test_drift_and_convergence() -> None:
    noise = long_recursion(0.6, -0.19, 2500, 1) * 0.4
    found, _ = fltea_fit(noise, H, config())
    assert found.converged
    assert abs(found.alpha_drift or 9) < 0.05
    other, _ = fltea_fit(noise[:320], H, config())
    assert abs(other.alpha_drift) > abs(found.alpha_drift or 0)


def axis_of(y: np.ndarray, settings: EstimatorConfig, gaps: Gaps | None = None) -> FlteaAxis:
    return FlteaAxis(y, gaps or no_gaps(), settings, LSB, None)


def test_a_record_that_is_too_short_is_refused() -> None:
    short = axis_of(np.arange(250.0) % 7, EstimatorConfig(startup=200))
    with pytest.raises(ValueError, match="start-up"):
        short.why_not(H)
    with pytest.raises(ValueError, match="start-up"):
        fltea_fits([axis_of(counts(1), EstimatorConfig(startup=200)), short], H)


def test_axes_side_by_side_give_what_each_gives_alone() -> None:
    """Results are equal in every bit, whether axes are processed together or alone.

    The axes have different lengths and settings. Samples are lost, and one axis is constant at first.
    """
    gaps = Gaps(np.array([500, 3000, 4100]), np.array([3, 1, 500]))
    axes = [
        axis_of(counts(1, 9000), config()),
        axis_of(counts(2, 5000), config(), gaps),
        axis_of(np.ones(5000), config()),
        axis_of(counts(3, 4100), config(R=0.3, bias=0.1)),
        axis_of(counts(4, 6001), config(window=200, variant="triple")),
        axis_of(ar((0.9,), 5000, 1, 5)[0], AccelConfig(window=150, startup=120)),
    ]
    together = fltea_fits(axes, H)
    assert together == [fltea_fits([one], H)[0] for one in axes]
    assert together[1].own is not None
    assert (together[1].own.samples, together[1].own.predicted) == (4100, 4)
    assert "constant" in together[2].reason == axes[2].why_not(H)
    assert [one.own and one.own.variant for one in together][4:] == ["triple", "joint"]
    assert together[4].other is not None
    assert together[4].innovations.keys() == {"triple", "joint"}


def band(y: np.ndarray, settings: EstimatorConfig, copies: int) -> ShuffledBand:
    found, _ = fltea_fit(y, H, settings, LSB)
    return shuffled_band([estimate(y, H, settings, LSB, range(copies), 0)], found.alpha, found.f)


def test_a_copy_is_what_the_daemon_gives_for_it() -> None:
    """The quantiles over shuffled copies are, for a single copy, the estimate for this copy.

    It agrees with the daemon's estimate for the same samples, except for errors of the compressed memory.
    """
    y = counts(2)
    settings = config()
    found = shuffled_band([estimate(y, H, settings, LSB, range(3, 4), 5)], 0.1, -0.1)
    expected, _ = fltea_fit(np.random.default_rng((5, 3)).permutation(y), H, settings, LSB)
    assert found.alpha[1] == pytest.approx(expected.alpha, abs=1e-4)
    assert found.f[1] == pytest.approx(expected.f, abs=1e-3)


def test_white_noise_lies_within_its_band_in_its_share() -> None:
    ranks = [band(counts(seed, 600), config(), copies=60).alpha_rank for seed in range(40)]
    assert all(rank is not None for rank in ranks)
    outside = sum(not 0.05 <= rank <= 0.95 for rank in ranks if rank is not None)
    assert outside <= 10
    assert 0.3 < np.mean([rank for rank in ranks if rank is not None]) < 0.7


def test_noise_with_an_order_lies_outside() -> None:
    found = band(long_recursion(0.7, -0.12, 2000, 3) * 0.4, config(), copies=40)
    assert found.alpha_rank == 1.0
    assert found.alpha[0] <= found.alpha[1] <= found.alpha[2]
    assert found.lost == 0


def test_shuffles_follow_the_seed() -> None:
    y = counts(1)
    one, same, other = (estimate(y, H, config(), LSB, range(4), seed).alpha.tolist() for seed in (1, 1, 2))
    assert one == same
    assert len(set(one + other)) == 8


def test_copies_do_not_depend_on_their_group() -> None:
    """The results of a shuffled copy are equal in every bit in any group of copies, even if one copy of the
    group diverges.
    """
    y = counts(1)
    for settings in (config(), config(variant="triple", guard="off", R=0.001)):
        whole = estimate(y, H, settings, LSB, range(11), 1)
        parts = [estimate(y, H, settings, LSB, part, 1) for part in (range(1), range(1, 9), range(9, 11))]
        for name in ("alpha", "f", "lost"):
            together = np.concatenate([getattr(part, name) for part in parts])
            np.testing.assert_array_equal(together, getattr(whole, name))
        assert shuffled_band(parts, 0.1, 0.1) == shuffled_band([whole], 0.1, 0.1)


@given(st.integers(1, 10**8), st.integers(0, 1000))
def test_groups_have_every_copy_once_in_bounded_memory(samples: int, copies: int) -> None:
    found = groups(samples, copies)
    assert [number for group in found for number in group] == list(range(copies))
    for group in found:
        assert 1 <= len(group) <= MOST_LANES
        assert len(group) <= LEAST_LANES or len(group) * min(samples, LONGEST) * 8 <= GROUP_BYTES


def test_copies_that_run_away_are_counted_and_left_out() -> None:
    found = band(counts(1), config(variant="triple", guard="off", R=0.001), copies=16)
    assert found.lost > 0
    assert found.copies == 16
    for values in (found.alpha, found.f):
        assert values is None or np.isfinite(values).all()
    msgspec.json.encode(found)


def test_innovations_that_are_white() -> None:
    """For white innovations, the p-values of Ljung and Box's test are uniform.

    The mean normalised square (`nis`) is 1, and the correlation of neighbours (`lag1`) is 0.
    """
    found = [innovations(2 * e, np.full(1000, 2.0)) for e in white(1000, 200, 1)]
    p = np.array([i.ljung_box_p for i in found if i is not None])
    assert len(p) == 200
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=0.045)
    assert (p < 0.5).mean() == pytest.approx(0.5, abs=0.1)
    assert np.mean([i.nis for i in found if i is not None]) == pytest.approx(1, abs=0.02)
    assert np.mean([i.lag1 for i in found if i is not None]) == pytest.approx(0, abs=0.01)


def test_innovations_that_are_not() -> None:
    coloured = innovations(ar((0.3,), 1000, 1, 1)[0], np.ones(1000))
    assert coloured.ljung_box_p < 1e-6
    assert coloured.lag1 == pytest.approx(0.3, abs=0.1)
    assert innovations(np.full(500, np.nan), np.ones(500)) is None
    assert innovations(np.ones(50), np.ones(50)) is None
