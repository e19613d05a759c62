"""Tests of `--inflate auto`, which enlarges the noise figures until the forecast is true for the recording
from which they come.
"""

import math
from pathlib import Path
from typing import NamedTuple

import fltea
import numpy as np
import pytest
import yaml
from fltea.documents.imu_yaml import AxisNoise, Inflation, Shown, imu_yaml
from fltea.identification.forecast import Forecast
from fltea.identification.forecast_judge import Errors, Piece
from fltea.identification.inflation import own_inflation
from fltea.records.errors import UsageError
from fltea.records.plus_minus import NORMAL_95
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.host_support import fltea_here

N, H = 60000, 0.01  # number of samples in ten minutes at 100 Hz
U = np.clip((np.arange(N) * H - 300) / 300, 0, None)
"""A drift of the bias that is 0 in the first half of a record, and then rises to 1 at the end."""


def at_rest(seed: int, warms_up_by: float = 0.0, walk: float = 0.0) -> np.ndarray:
    """Return white noise with N = 0.3 deg/√h and a bias that drifts in the second half, as it does with
    temperature.
    """
    rng = np.random.default_rng((77, seed))
    y = 0.2 + rng.normal(0.0, 0.05, N) + np.cumsum(rng.normal(0.0, walk * math.sqrt(H), N))
    return y + warms_up_by * (1 - np.exp(-3 * U))


def inflated(y: np.ndarray, up_to_s: float = 60.0) -> Inflation:
    return own_inflation({"gyro_x": fltea.identify(y, 1 / H, unit="deg/s", forecast=True)}, up_to_s)


@pytest.mark.long
def test_a_right_model_gets_no_factor_and_a_drift_gets_one() -> None:
    factors = [inflated(at_rest(seed, walk=1e-4 * (seed % 3))).of_axes["gyro_x"] for seed in range(6)]
    assert factors.count(1.0) >= 5
    drifting = [inflated(at_rest(seed, 0.05)) for seed in range(4)]
    assert all(one.of_axes["gyro_x"] > 1.2 for one in drifting)
    assert all("what the model does not describe" in one.reasons[0] for one in drifting)


class Axis(NamedTuple):
    unit: str
    forecast: Forecast | None


def piece(t_s: float, pieces: int, needed: float, deviations: float = 9.0, said: float = 0.01) -> Piece:
    return Piece(t_s, pieces, said, said * needed, 0.8, deviations, abs(deviations) > 3, needed)


def axis(*pieces: Piece, whole: float = 0.01, unit: str = "deg/s", judged: str = "white noise") -> Axis:
    """Return the result of an axis, with only what the tests need: the forecast of its heading error.

    `pieces`: how large the errors of the heading were in pieces of the recording. `whole`: the σ that is
    forecast from the whole recording.
    """
    times = tuple(one.t_s for one in pieces)
    found = Forecast(times, (whole,) * len(times), pieces, (), "white noise", judged, "")
    return Axis(unit, found)


def test_the_time_that_wants_most_counts_if_it_has_enough_pieces() -> None:
    few = piece(60.0, 5, 9.0)
    found = own_inflation({"gyro_x": axis(piece(1.0, 300, 1.2), piece(10.0, 30, 2.31), few)}, 60.0)
    assert found.of_axes == {"gyro_x": 2.4}
    assert "for up to 10 s" in found.reasons[0]
    assert "A check up to 60 s needs a recording of 40 min; the 5 pieces of 60 s" in found.reasons[0]
    assert "want 9" in found.reasons[0]
    shorter = own_inflation({"gyro_x": axis(piece(1.0, 300, 1.2), piece(10.0, 30, 2.31), few)}, 10.0)
    assert "recording" not in shorter.reasons[0].split("10 s", 1)[1]


def test_what_chance_or_the_whole_recording_explains_gets_no_factor() -> None:
    pieces = piece(1.0, 300, 1.2, 1.0), piece(10.0, 30, 1.6, 2.0)
    by_chance = own_inflation({"gyro_x": axis(*pieces), "gyro_y": axis(*pieces)}, 10.0)
    assert by_chance.of_axes == {"gyro_x": 1.0, "gyro_y": 1.0}
    assert by_chance.reasons == (
        "gyro_x, gyro_y: times 1: the first half's 95 % band of the heading held in the second, for up to "
        "10 s.",
    )
    less = own_inflation({"gyro_x": axis(piece(10.0, 30, 0.4, -9.0))}, 10.0)
    assert less.of_axes == {"gyro_x": 1.0}
    known = own_inflation({"accel_x": axis(piece(10.0, 30, 2.0), whole=0.03, unit="m/s²")}, 10.0)
    assert known.of_axes == {"accel_x": 1.0}
    assert "the velocity of the second half went beyond" in known.reasons[0]


def test_a_record_that_is_too_short_or_has_no_model_is_told() -> None:
    for short in (axis(), axis(piece(1.0, 300, 1.0), piece(10.0, 19, 1.0))):
        with pytest.raises(UsageError, match=r"gyro_x: .* 20 pieces of 10 s .* Record for 7 min or longer"):
            own_inflation({"gyro_x": short}, 60.0)
    for none in (axis(judged=""), Axis("deg/s", None)):
        with pytest.raises(UsageError, match="nothing is predicted"):
            own_inflation({"gyro_x": none}, 60.0)


@given(st.floats(0.01, 1e4), st.floats(0.1, 10.0))
def test_a_factor_has_two_digits_and_is_enough(needed: float, ratio: float) -> None:
    found = own_inflation({"x": axis(piece(10.0, 20, needed), whole=0.01 / ratio)}, 10.0).of_axes["x"]
    wanted = max(needed * ratio, 1.0)
    assert wanted * (1 - 1e-8) <= found <= wanted * 1.1
    assert found == float(f"{found:.2g}")


@given(st.lists(st.floats(0.0, 50.0), min_size=5, max_size=100))
def test_the_band_is_as_wide_as_95_percent_need(errors: list[float]) -> None:
    seen = np.array(errors)
    needed = Errors(seen, np.ones(len(seen))).needed
    assert (seen <= needed * NORMAL_95 * (1 + 1e-12)).mean() >= 0.95
    assert needed == 0 or (seen < needed * NORMAL_95 * (1 - 1e-12)).mean() < 0.95


def test_each_axis_has_its_own_factor_and_the_worst_counts() -> None:
    """The figures of each axis are multiplied by the factor of this axis. imu.yaml gets the largest product.

    It may come from an axis with less noise than another.
    """
    gyro = {"gyro_x": AxisNoise(Shown(0.02), Shown(0.5)), "gyro_y": AxisNoise(Shown(0.03), Shown(0.4))}
    own = Inflation(1.0, 1.0, {"gyro_x": 2.0, "gyro_y": 1.0}, ("gyro_x: times 2: for this.",))
    text = imu_yaml(gyro, 100.0, "rest.npz", inflation=own)
    found = yaml.safe_load(text)
    assert found["gyroscope_noise_density"] == pytest.approx(math.radians(0.04), rel=1e-6)
    assert found["gyroscope_random_walk"] == pytest.approx(math.radians(1.0), rel=1e-6)
    assert "# Inflated: gyro_x: times 2: for this." in text
    assert "of gyro_x; 2 times the measured" in text


@pytest.mark.slow
def test_the_command_inflates_by_the_recording(tmp_path: Path) -> None:
    noise = np.stack([at_rest(1), at_rest(2, 0.05)], axis=1)
    np.savez(tmp_path / "rest.npz", gyro_dps=np.column_stack([noise, at_rest(3)]), fs_hz=1 / H)
    command = ("identify", tmp_path / "rest.npz", "--jobs", "1")
    own, plain = (
        yaml.safe_load(fltea_here(*command, "--for", "kf-gins", *more).stdout)["imunoise"]["arw"]
        for more in (("--inflate", "auto"), ())
    )
    assert [own[0], own[2]] == [plain[0], plain[2]]
    assert own[1] > 1.3 * plain[1]
    done = fltea_here(*command, "--imu-yaml", tmp_path / "imu.yaml", "--inflate", "auto", columns=300)
    assert (done.returncode, done.stderr.count("fltea: inflated ")) == (0, 2)
    assert "# Inflated: gyro_y: times" in (tmp_path / "imu.yaml").read_text(encoding="utf-8")
    np.savez(tmp_path / "short.npz", gyro_dps=noise[:20000], fs_hz=1 / H)
    done = fltea_here("identify", tmp_path / "short.npz", "--jobs", "1", "--for", "px4", "--inflate", "auto")
    assert (done.returncode, done.stdout) == (2, "")
    assert "Record for 7 min or longer" in done.stderr
