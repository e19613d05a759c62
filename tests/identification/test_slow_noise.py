"""Tests of the figures of noise that is slower than a spectrum shows.

The figures are K and its bound, B, the drift rate, and the states that a filter needs.
"""

import csv
import math
from collections.abc import Callable
from pathlib import Path

import fltea
import numpy as np
import pytest
from fltea.identification.allan import allan_of
from fltea.identification.allan_file import COLUMNS
from fltea.identification.axis import AxisAnalysis, IdentifyOptions, analyse
from fltea.identification.axis_report import AxisReport
from fltea.identification.conclusions import tracked_of
from fltea.identification.findings import rows
from fltea.identification.forecast import made_of
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.slow_noise import band, next_of_white
from fltea.identification.tracked_drift import tracked_drift_rate
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.spectrum.drift_rate import around

from tests.rig.host_support import fltea_here
from tests.rig.identify_files import QUICK
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, gauss_markov
from tests.rig.tiers import long

N_TRUE, SIGMA = 0.01, 0.1
OPTIONS = IdentifyOptions(QUICK, shuffles=0)
Noise = Callable[[np.random.Generator, int], Array]


def white(rng: np.random.Generator, n: int) -> Array:
    return rng.normal(0, SIGMA, n)


def walk(K: float) -> Noise:
    return lambda rng, n: white(rng, n) + np.cumsum(rng.normal(0, K * math.sqrt(H), n))


def flicker(B: float) -> Noise:
    """Return white noise plus 1/f noise with the two-sided spectrum B²/(2πf).

    The 1/f noise is the beginning of a periodic noise whose period is at least eight times as long.
    """

    def draw(rng: np.random.Generator, n: int) -> Array:
        size = 1 << (8 * n - 1).bit_length()
        hz = np.fft.rfftfreq(size, H)
        hz[0] = hz[1] / 2
        scale = B * np.sqrt(size / (4 * np.pi * hz * H))
        half = (rng.normal(size=len(hz)) + 1j * rng.normal(size=len(hz))) * scale
        return np.asarray(white(rng, n) + np.fft.irfft(half, size)[:n])

    return draw


def relaxing(rng: np.random.Generator, n: int) -> Array:
    return white(rng, n) + gauss_markov(rng, n, H, 0.01, 30.0)


def looks(noise: Noise, n: int, count: int, seed: int) -> list[AxisAnalysis]:
    return [analyse(noise(np.random.default_rng((seed, i)), n), H) for i in range(count)]


def drift_rate(analysis: AxisAnalysis) -> Interval:
    tracked = tracked_of(analysis)
    assert tracked is not None
    return tracked_drift_rate(tracked, analysis.y, H)


# --- B ---


def test_b_of_flicker_noise_is_that_of_the_spectrum() -> None:
    found = [allan_of(one, GYRO_UNIT).B for one in looks(flicker(0.01), 60_000, 6, 1)]
    assert {one.of for one in found} == {"spectrum"}
    found = [one for one in found if one.value is not None]
    assert len(found) >= 5
    values = [one.value for one in found]
    assert values == pytest.approx([0.01] * len(values), rel=0.3)
    assert np.mean(values) == pytest.approx(0.01, rel=0.12)
    assert all(one.low < one.value < one.high for one in found)


@pytest.mark.slow
def test_the_interval_of_b_holds_the_truth() -> None:
    """Of 60 intervals of B, 57 are expected to contain the truth. 50 are four standard deviations less."""
    found = [allan_of(one, GYRO_UNIT).B for one in looks(flicker(0.01), 30_000, 60, 2)]
    known = [one for one in found if one.of == "spectrum" and one.value is not None]
    assert len(known) >= 45
    assert np.mean([one.low < 0.01 < one.high for one in known]) > 0.86


def test_b_is_not_made_up_where_there_is_a_walk_or_white_noise() -> None:
    for noise in (white, walk(3e-4)):
        for one in looks(noise, 60_000, 4, 3):
            B = allan_of(one, GYRO_UNIT).B
            assert B.value is None
            assert "B is at most" in B.reason
            assert B.at_most is not None


def test_command_python_and_file_have_one_curve(tmp_path: Path) -> None:
    y = flicker(0.01)(np.random.default_rng(4), 80_000)
    np.savetxt(tmp_path / "rest.csv", y, header="gyro_x", comments="")
    recording = fltea.open(tmp_path / "rest.csv", units="deg/s", rate_hz=100.0)
    report = recording.identify()
    axis = report["gyro_x"]
    command = identify_series(Series(recording["gyro_x"], GYRO_UNIT, None), H, OPTIONS, False)
    assert command.allan is not None
    assert command.allan.B.value is not None
    assert command.allan == axis.allan_curve
    assert (command.allan.N.value, command.allan.B.value) == (axis.allan.N, axis.allan.B)
    path = tmp_path / "allan.csv"
    report.write_allan_csv(path)
    table, written = report.allan(), read(path)
    assert tuple(written[0]) == tuple(COLUMNS) == tuple(table.columns)
    assert [float(row["adev"]) for row in written] == list(command.allan.deviation) == list(table["adev"])
    assert {row["unit"] for row in written} == {"deg/s"}
    assert all(float(row["adev_low"]) < float(row["adev"]) < float(row["adev_high"]) for row in written)
    assert int(written[0]["differences"]) == len(y) - 1


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_command_writes_the_curves(tmp_path: Path) -> None:
    y = np.random.default_rng(5).normal(size=(3000, 2))
    np.savetxt(tmp_path / "rest.csv", y, delimiter=",", header="gyro_x,gyro_y", comments="")
    how = ("--units", "deg/s", "--rate", "100", "--shuffles", "0", "--allan-csv", tmp_path / "allan.csv")
    done = fltea_here("identify", tmp_path / "rest.csv", *how)
    assert done.returncode == 0, done.stderr
    written = read(tmp_path / "allan.csv")
    assert [row["axis"] for row in written][:: len(written) - 1] == ["gyro_x", "gyro_y"]
    assert all(float(row["adev_model"]) > 0 for row in written)


# --- K, and the states that a filter needs ---


def report_of(noise: Noise, n: int, seed: int) -> AxisReport:
    y = noise(np.random.default_rng(seed), n)
    return identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False, forecast=True)


def test_k_is_bounded_where_it_is_not_known() -> None:
    axis = report_of(white, 60_000, 6)
    level = axis.result.level
    assert axis.walk is not None
    assert axis.allan is not None
    assert (level.K.value, level.K_at_most) == (None, axis.walk.at_most)
    assert axis.allan.K.at_most == level.K_at_most
    bound = f"at most {level.K_at_most * 216_000:.3g}"
    assert bound in dict(rows(axis))["  K [deg/h/√h]"]
    assert bound in axis.allan.K.reason
    said = axis.result.verdict
    assert said.next.startswith("A filter needs only its density N: ")
    assert bound in said.next
    assert said.text.endswith(said.next)


def test_a_walk_that_only_the_tracker_sees_is_in_all_figures() -> None:
    axis = report_of(walk(1e-3), 60_000, 7)
    assert axis.walk is not None
    assert axis.walk.said == "walks"
    assert axis.allan is not None
    assert axis.result.level.K == axis.walk.K
    assert axis.allan.K.value == axis.walk.K.value
    assert axis.forecast is not None
    assert "walk" in axis.forecast.made_of
    assert axis.walk.K.low < 1e-3 < axis.walk.K.high


@pytest.mark.slow
def test_k_is_the_middle_of_what_is_likely() -> None:
    """K is the median of its probable values, so it is as often too large as too small.

    The median of K over 20 axes is known to about 5 %.
    """
    found = []
    for one in looks(walk(1e-3), 60_000, 20, 8):
        tracked = tracked_of(one)
        assert tracked is not None
        found.append(tracked.walk.K(H))
    known = [one for one in found if one.value is not None]
    assert len(known) >= 18
    assert sum(one.low < 1e-3 < one.high for one in known) >= len(known) - 2
    assert np.median([one.value for one in known]) == pytest.approx(1e-3, rel=0.15)


def test_only_n_where_the_curve_is_that_of_white_noise() -> None:
    constant = OffsetWalkFound("likely constant", Interval(), 1e-4, None)
    inside = 0
    for one in looks(white, 20_000, 10, 9):
        curve = allan_of(one, GYRO_UNIT)
        inside += band(curve).leaves_at_s is None
        walks = OffsetWalkFound("walks", Interval(1e-3, 5e-4, 2e-3), None, None)
        if band(curve).leaves_at_s is None:
            assert "needs only its density N" in next_of_white(curve, constant, GYRO_UNIT)
            assert "and the walk of its offset. The offset walks: K is 216 " in next_of_white(
                curve, walks, GYRO_UNIT
            )
    assert inside >= 8
    slow = white(np.random.default_rng(10), 60_000) + 0.004 * np.sin(np.arange(60_000) * H * 2 * np.pi / 900)
    curve = allan_of(analyse(slow, H, IdentifyOptions(from_hz=0.05)), GYRO_UNIT)
    left = band(curve)
    assert left.leaves_at_s is not None
    assert 1 < left.to_s < left.leaves_at_s
    said = next_of_white(curve, constant, GYRO_UNIT)
    assert "only" not in said
    assert "K is at most 21.6 deg/h/√h (95 %)" in said


# --- the drift rate ---


def test_an_interval_of_several_variances() -> None:
    assert around(1.0, [4.0], [1.0]).high == pytest.approx(1 + 2 * 1.96, rel=1e-3)
    both = around(0.0, [1.0, 100.0], [0.5, 0.5]).high
    # By hand: two normal distributions, σ = 1 and σ = 10, have equal weights. Beyond the interval, there is
    # only the wide one. 5 % of the whole are outside, which are 10 % of the wide one. Of a normal
    # distribution, 10 % are outside of ± 1.645 σ = ± 16.45.
    assert both == pytest.approx(16.45, rel=1e-3)
    assert around(0.0, [0.0], [1.0]) == Interval(0.0, 0.0, 0.0)


def test_the_drift_rate_of_a_walk_holds_no_drift() -> None:
    found = [drift_rate(one) for one in looks(walk(1e-3), 30_000, 12, 11)]
    assert sum(one.low < 0 < one.high for one in found) >= 10


def test_a_ramp_is_seen_in_white_noise() -> None:
    rate = 1e-3
    y = white(np.random.default_rng(12), 30_000) + rate * H * np.arange(30_000)
    found = drift_rate(analyse(y, H))
    assert 0 < found.low < rate < found.high


@pytest.mark.slow
@pytest.mark.parametrize(
    "noise", [walk(1e-3), long(relaxing), long(flicker(0.01))], ids=["walk", "relaxation", "flicker"]
)
def test_the_drift_rate_holds_the_truth(noise: Noise) -> None:
    """Of 40 intervals, 38 are expected to contain the truth. 33 would be four standard deviations less."""
    found = [drift_rate(one) for one in looks(noise, 30_000, 40, 13)]
    assert sum(one.low < 0 < one.high for one in found) >= 34


# --- the inputs of a forecast ---


def test_a_forecast_is_made_of_what_its_system_has() -> None:
    tracked = tracked_of(analyse(walk(1e-3)(np.random.default_rng(14), 60_000), H))
    assert tracked is not None
    assert made_of(tracked).startswith("white")
    assert "walk of the offset" in made_of(tracked)
    constant = tracked_of(analyse(white(np.random.default_rng(15), 60_000), H))
    assert constant is not None
    weights = np.where(constant.walk.steps == 0, constant.walk.weights, 0.0)
    still = constant.walk._replace(weights=weights / weights.sum())
    assert made_of(constant._replace(walk=still)) == "white"
