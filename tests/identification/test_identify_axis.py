"""Tests of the whole result of `identify` for one axis, on noise of known kinds and on real recordings."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.identification.axis import AxisResult, IdentifyOptions, with_copies
from fltea.identification.shuffled import estimate
from fltea.identification.sums import examined
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.periodogram import FEWEST
from fltea.spectrum.spectral_lines import Peak
from fltea.spectrum.verdict import decide

from tests.rig.identify_files import identify_axis
from tests.rig.identify_support import H, ar, long_recursion, white

QUICK = IdentifyOptions(shuffles=20)


def kind(y: np.ndarray) -> str:
    return decide(examined(y, H).evidence).kind


def test_white_noise() -> None:
    lsb = 1 / 16.4
    y = np.rint((3 + 0.14 * white(3000, 1, 1)[0]) / lsb) * lsb
    found = identify_axis(y, H, lsb, QUICK)
    assert found.verdict.kind == "white"
    assert found.null.p_value > 0.05
    assert found.null.critical_5_percent < found.null.critical_1_percent
    assert (found.order.alpha.value, found.order.f.value) == (None, None)
    assert found.fltea.variant == "joint"
    assert found.fltea_other.variant == "triple"
    assert set(found.innovations) == {"joint", "triple"}
    assert found.mean == pytest.approx(3, abs=0.01)
    assert found.std == pytest.approx(0.14, rel=0.05)
    assert found.duration_s == pytest.approx(30)


def test_as_json_and_back() -> None:
    """Every value of a result can be written in JSON and read back, and the names are those that are
    documented.
    """
    found = identify_axis(long_recursion(0.6, -0.19, 1000, 1), H, None, QUICK)
    copies = estimate(white(1000, 1, 1)[0], H, QUICK.estimator, None, range(3), 0)
    found = with_copies(found, [copies])
    assert found.null.shuffled is not None
    data = msgspec.json.encode(found)
    assert msgspec.json.decode(data, type=AxisResult) == found
    plain = msgspec.json.decode(data)
    assert {"variant", "guard", "window", "startup", "state", "joint"} <= set(plain["fltea"]["settings"])
    assert plain["fltea_other"]["settings"]["variant"] == "triple"
    assert {"white", "plain", "rich"} <= set(plain["models"])


def test_broad_resonance_is_not_called_white() -> None:
    """The resonance in this noise is at a middle frequency, and too broad to count as a peak.

    The null test compares white noise only with noises of orders up to 1. These cannot describe such a
    resonance, so the null test finds nothing.
    """
    seen = examined(ar((0.0, -0.25), 3000, 1, 0)[0], H).evidence
    assert seen.p_all > 0.05
    assert not seen.peaks
    verdict = decide(seen)
    assert verdict.kind == "resonance"
    assert "resonance at 25.3 Hz" in verdict.text
    assert "18.6 Hz wide" in verdict.text


def test_short_fractional_noise_is_not_called_so() -> None:
    for seed in range(2):
        y = long_recursion(0.6, -0.19, 3000, seed)
        assert kind(y) not in ("white", "fractional")


def test_fractional_noise_is_called_so_with_the_sum_that_does_as_well() -> None:
    y = long_recursion(0.6, -0.19, 60_000, 0) + 0.5 * white(60_000, 1, 10)[0]
    verdict = decide(examined(y, H).evidence)
    assert verdict.kind == "fractional or relaxations"
    assert "an order of 0.5" in verdict.text or "an order of 0.6" in verdict.text
    assert "the model without an order" in verdict.next


def test_notch_and_from_hz_leave_out() -> None:
    n = 6000
    y = white(n, 1, 3)[0] + 0.5 * np.sin(2 * np.pi * 20.02 * np.arange(n) * H)
    seen = examined(y, H, from_hz=1.0, notch=((19.0, 21.0),))
    assert not seen.evidence.peaks
    assert seen.band.from_hz == 1.0
    ((low, high),) = seen.band.notch_hz
    # The notch of 19 to 21 Hz is widened on both sides, because Hann's window spreads the power of a line to
    # neighbouring frequencies.
    assert (low, high) == (pytest.approx(18.4, abs=0.02), pytest.approx(21.6, abs=0.02))
    assert seen.ordinates == pytest.approx(46 * 60 * 0.94, rel=0.06)
    assert examined(y, H).evidence.peaks


def peaks(*bands: tuple[float, float]) -> tuple[Peak, ...]:
    return tuple(
        Peak("resonance", (low + high) / 2, high - low, 0.1, 9.0, (low, high)) for low, high in bands
    )


def test_peaks_without_end_leave_half_of_the_ordinates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Peaks are left out of the fit. At least half of the periodogram must remain for the fit.

    If leaving out all peaks would leave less, the weakest peaks stay in the fit, and no more than necessary.
    """
    y = white(1000, 1, 1)[0]
    found = peaks((5, 15), (20, 30), (35, 37), (38, 48))
    monkeypatch.setattr("fltea.identification.fine_peaks.find_peaks", lambda p: found)
    seen = examined(y, H)
    assert seen.evidence.peaks == found[:3]
    assert seen.band.notch_hz == tuple(peak.notch_hz for peak in found[:3])
    assert 0.5 * seen.ordinates <= seen.band.ordinates < 0.6 * seen.ordinates


def test_a_short_record_keeps_enough_ordinates_to_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit needs at least `FEWEST` values of the periodogram.

    If the peak were left out of this short record, more than half of the values would remain, but fewer than
    `FEWEST`. So the peak stays in.
    """
    monkeypatch.setattr("fltea.identification.fine_peaks.find_peaks", lambda p: peaks((10, 25)))
    seen = examined(white(180, 1, 2)[0], H)
    assert FEWEST <= seen.band.ordinates == seen.ordinates - 6
    assert seen.evidence.peaks == ()


def test_drift_is_not_among_what_is_fitted() -> None:
    """The fit and the p-value `p_clean` leave out frequencies with fewer than ten periods per record.

    The p-value `p_all` includes lower frequencies, and shows the drift.
    """
    n = 30_000
    y = white(n, 1, 3)[0] + 0.1 * np.sin(2 * np.pi * 5 * np.arange(n) / n)
    seen = examined(y, H)
    assert seen.band.from_hz == pytest.approx(1 / 30)
    # the frequencies with 4 to 9 periods per record count in p_all, but are not fitted
    assert 4 <= seen.ordinates - seen.band.ordinates <= 6
    assert seen.evidence.p_all < 1e-3
    assert seen.evidence.p_clean > 0.05
    assert decide(seen.evidence).kind == "drift"
    assert "drift below 0.0333 Hz" in decide(seen.evidence).text
    assert examined(y, H, from_hz=0.01).band.from_hz == pytest.approx(1 / 30)
    assert examined(y, H, from_hz=0.5).band.from_hz == 0.5


def test_given_settings_reach_the_estimators() -> None:
    y = white(2000, 1, 1)[0]
    options = IdentifyOptions(EstimatorConfig(variant="triple", guard="off", R=2.0, startup=50), shuffles=0)
    found = identify_axis(y, H, None, options)
    assert (found.fltea.variant, found.fltea.guard, found.fltea.R) == ("triple", "off", 2.0)
    assert (found.fltea_other.variant, found.fltea_other.R) == ("joint", 2.0)
    assert found.null.shuffled is None


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"from_hz": -1.0}, "from_hz"),
        ({"notch_hz": ((5.0, 4.0),)}, "notch_hz"),
        ({"shuffles": -1}, "shuffles"),
    ],
)
def test_options_are_checked(more: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        IdentifyOptions(**more)  # type: ignore[arg-type]


def test_one_axis_only() -> None:
    with pytest.raises(ValueError, match="one axis"):
        identify_axis(np.zeros((500, 3)), H)


def test_real_recordings(recordings: Path) -> None:
    """None of the measured axes is fractional, and the resonance of the z axis is recognised."""
    kinds = {}
    for name in ("mpu6050_sunsided_10min", "mpu6050_tomisuarez_100s"):
        with np.load(recordings / f"{name}.npz") as d:
            y, h = d["gyro_raw"] / float(d["lsb_per_dps"]), 1 / float(d["fs_hz"])
        for axis in range(3):
            seen = examined(y[:, axis], h)
            kinds[name[8:11] + "xyz"[axis]] = decide(seen.evidence).kind
            if name[8:11] + "xyz"[axis] == "sunz":
                (peak,) = seen.evidence.peaks
                assert peak.frequency_hz == pytest.approx(31.4, abs=0.1)
                assert peak.power_share == pytest.approx(0.25, abs=0.05)
    assert kinds == {
        "sunx": "drift",
        "suny": "drift",
        "sunz": "resonance",
        "tomx": "white",
        "tomy": "line",
        "tomz": "white",
    }
