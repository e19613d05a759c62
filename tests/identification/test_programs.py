"""Tests of noise figures in the units of other programs, which are checked with those programs' examples."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from fltea.documents.imu_yaml import Inflation, Shown
from fltea.documents.programs import FilterFigures, Program, programs, written
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport
from fltea.identification.filter_figures import filter_figures
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.navigation_filter import FilterState, NavigationFilter
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.host_support import fltea_here
from tests.rig.identify_files import QUICK, counts, npz
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, Truth, composite, white

PROGRAMS = programs()
AS_MEASURED = Inflation(1.0, 1.0)
PAGE = Path(__file__).parents[2] / "host/docs/cookbook/which_figure.md"


@pytest.mark.parametrize("name", PROGRAMS)
def test_its_own_examples_come_out(name: str) -> None:
    """A program's default or documented value converts to the noise figure that it means, and back."""
    program = PROGRAMS[name]
    assert program.checked
    for one in program.checked:
        entry = program.entry(one.name)
        assert entry.value(one.figure, one.rate_hz, program.step_s) == pytest.approx(one.value, rel=1e-5)
        assert entry.figure_of(one.value, one.rate_hz, program.step_s) == pytest.approx(one.figure, rel=1e-5)


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_row_of_the_table_is_whole(name: str) -> None:
    program = PROGRAMS[name]
    assert program.title
    assert program.about
    assert all("," in source for source in program.sources)
    assert all(hole in program.line for hole in ("{name}", "{value}", "{note}"))
    assert {entry.sensor for entry in program.entries} == {"gyro", "accel"}
    assert (program.step_s is not None) == any(entry.per == "step" for entry in program.entries)
    sigmas = [entry for entry in program.entries if entry.figure == "sigma"]
    assert bool(sigmas) == any(entry.figure == "tau" for entry in program.entries)


@pytest.mark.parametrize("name", PROGRAMS)
def test_help_and_the_page_know_it(name: str) -> None:
    """Every program in the table is named in the command's help and on the documentation's page."""
    shown = fltea_here("identify", "--help").stdout
    assert name in "".join(shown.replace("│", " ").split())
    page = PAGE.read_text(encoding="utf-8")
    assert f"`{name}`" in page
    assert [entry.name for entry in PROGRAMS[name].entries if entry.name.split(".")[-1] not in page] == []


def of(N: float, K: float | None, tau_s: float = 100.0) -> FilterFigures:
    walk = Shown(K) if K is not None else Shown(None, "no walk", 0.5)
    return FilterFigures(Shown(N), walk, Shown(tau_s if K is not None else None), Shown(None, "flat nowhere"))


GYRO = {"gyro_x": of(0.01, 0.002), "gyro_y": of(0.02, 0.001, 50.0), "gyro_z": of(0.015, 0.003)}
ACCEL = {"accel_x": of(0.001, 2e-4), "accel_y": of(0.003, 1e-4), "accel_z": of(0.002, 3e-4)}


def text(name: str, gyro: dict[str, FilterFigures] = GYRO, factors: Inflation = AS_MEASURED) -> str:
    return written(PROGRAMS[name], gyro, ACCEL, 200.0, "rest.npz", factors)


@pytest.mark.parametrize(
    "name", ["kalibr", "openvins", "vins-fusion", "okvis2", "kf-gins", "robot_localization"]
)
def test_yaml_is_yaml(name: str) -> None:
    found = yaml.safe_load(text(name))
    inside = found.get("imu0") or found.get("imu_parameters") or found.get("imunoise") or found
    assert {entry.name for entry in PROGRAMS[name].entries} <= inside.keys()
    for entry in PROGRAMS[name].entries:
        assert isinstance(inside[entry.name], float | list)


def test_the_worst_axis_counts_or_each_for_itself() -> None:
    kalibr = yaml.safe_load(text("kalibr"))
    assert kalibr["gyroscope_noise_density"] == pytest.approx(math.radians(0.02))
    assert kalibr["accelerometer_random_walk"] == pytest.approx(3e-4)
    assert kalibr["update_rate"] == 200
    vins = yaml.safe_load(text("vins-fusion"))
    assert vins["gyr_n"] == pytest.approx(math.radians(0.02) * math.sqrt(200), rel=1e-6)
    assert vins["acc_w"] == pytest.approx(3e-4 * math.sqrt(200), rel=1e-6)
    gins = yaml.safe_load(text("kf-gins"))["imunoise"]
    # N in deg/√h, which is 60 times N in deg/√s
    assert gins["arw"] == pytest.approx([0.6, 1.2, 0.9], rel=1e-6)
    assert gins["corrtime"] == pytest.approx(100 / 3600, rel=1e-6)
    # KF-GINS has one correlation time for all axes. So the σ of each axis's bias is chosen such that the
    # random walk of the bias stays the same.
    walks = [one * math.sqrt(100 / 2) for one in (0.002, 0.001, 0.003)]
    assert gins["gbstd"] == pytest.approx([3600 * one for one in walks], rel=1e-6)
    px4 = dict(line.split()[2:4] for line in text("px4").splitlines() if line.startswith("param"))
    assert float(px4["EKF2_GYR_B_NOISE"]) == pytest.approx(math.radians(0.003) * 10, rel=1e-6)


def test_python_and_matlab_can_be_pasted() -> None:
    space = {"np": np}
    exec(text("gnss-ins-sim"), space)
    assert space["imu_err"]["gyro_arw"] == pytest.approx([0.6, 1.2, 0.9], rel=1e-6)
    assert space["imu_err"]["gyro_b_corr"] == pytest.approx([100, 50, 100])
    set_: dict[str, np.ndarray] = {}

    class Params:
        def __getattr__(self, name: str) -> object:
            return lambda value: set_.__setitem__(name, value)

    exec(text("gtsam"), {"np": np, "params": Params()})
    assert np.diag(set_["setGyroscopeCovariance"]) == pytest.approx([math.radians(0.02) ** 2] * 3, rel=1e-5)
    lines = text("matlab-imusensor").splitlines()
    assert all(line.startswith("%") or line.partition("%")[0].rstrip().endswith(";") for line in lines)


def test_what_is_not_known_is_a_comment_with_its_bound() -> None:
    alone = {"gyro_x": of(0.01, None)}
    found = text("px4", alone)
    assert "param set EKF2_GYR_B_NOISE" not in found
    assert (
        "EKF2_GYR_B_NOISE [rad/s^2] is not known: no walk; gyro_x: at most 8.73e-02, with 95 % prob" in found
    )
    beside = yaml.safe_load(text("kf-gins", {**GYRO, "gyro_y": of(0.02, None)}))["imunoise"]
    assert beside["gbstd"][1] == pytest.approx(3600 * 0.5 * math.sqrt(50), rel=1e-6)
    assert "gyro_y: not known, at most this" in text("kf-gins", {**GYRO, "gyro_y": of(0.02, None)})
    nothing = written(PROGRAMS["px4"], GYRO, {}, 200.0, "rest.npz", AS_MEASURED)
    assert "EKF2_ACC_NOISE [m/s^2] is not known: the accelerometer was not analysed" in nothing


def test_inflation_multiplies_before_anything_is_squared() -> None:
    larger, as_measured = text("robot_localization", factors=Inflation(10.0, 1.0)), text("robot_localization")
    values = [yaml.safe_load(one)["angular_velocity_covariance"][0] for one in (larger, as_measured)]
    assert values[0] == pytest.approx(100 * values[1], rel=1e-5)
    assert "Inflated: densities 10 times" in larger


@pytest.fixture(scope="module")
def relaxing() -> AxisReport:
    y = composite(Truth(0.005, ((0.03, 1.0), (0.03, 0.05)), K=0.01), 200_000, H, 3)
    return identify_series(Series(y, GYRO_UNIT, None), H, IdentifyOptions(QUICK, shuffles=0), False)


def test_what_a_filter_allows_for_a_walk_that_is_not_seen_is_no_figure() -> None:
    """A filter may have a state for a random walk that the data neither show nor exclude. In an earlier
    version, such a state was written as a known random walk, even for white noise.
    """
    states = (FilterState(0.01, 6.0), FilterState(0.01, 100.0))
    axis = replace(AXIS, filter=NavigationFilter(0.011, 0.0, states, 0.0, 0.1, ()))
    found = filter_figures(axis)
    assert found.N.value == AXIS.result.level.N.value
    assert found.K.value is None
    assert found.K.at_most == pytest.approx(AXIS.result.level.K_at_most)
    assert found.said == ""


states = st.lists(st.tuples(st.floats(1e-3, 1.0), st.floats(0.05, 1e4)), max_size=4)


@given(st.floats(1e-3, 1.0), st.floats(0, 0.1), states, st.floats(0.5, 1e4))
def test_no_frequency_has_more_than_what_is_written(
    N: float, K: float, some: list[tuple[float, float]], up_to_s: float
) -> None:
    plain = NavigationFilter(N, K, tuple(FilterState(*one) for one in some), 0.0, 0.1, ())
    verdict = replace(AXIS.result.verdict, kind="relaxations")
    axis = replace(AXIS, result=replace(AXIS.result, verdict=verdict))
    found = filter_figures(replace(axis, filter=plain), up_to_s)
    omega = 2 * np.pi * np.geomspace(1e-6, 1e3, 300)
    own = N**2 + (K / omega) ** 2
    for sigma, tau_s in some:
        own = own + 2 * sigma**2 * tau_s / (1 + (omega * tau_s) ** 2)
    written_ = (found.N.value or N) ** 2 + ((found.K.value or 0.0) / omega) ** 2
    if some:
        assert (written_ >= own * (1 - 1e-9)).all()
        ratio = found.said.partition("these figures predict ")[2].split()[0]
        assert ratio == "about" or float(ratio) >= 1.05


AXIS = identify_series(
    Series(0.1 * white(3000, 1, 1)[0], GYRO_UNIT, None), H, IdentifyOptions(QUICK, shuffles=0), False
)


def test_a_relaxation_is_told_and_bounded(relaxing: AxisReport) -> None:
    short, long = filter_figures(relaxing, 0.1), filter_figures(relaxing, 600.0)
    assert "as a walk" in short.said
    assert "as white noise" in long.said
    assert (short.K.value or 0) > (long.K.value or 0)
    assert (long.N.value or 0) > (short.N.value or 0)


def test_the_command_prints_the_lines_alone(tmp_path: Path) -> None:
    path = npz(tmp_path / "a.npz", counts(3000), accel_raw=counts(3000), accel_lsb_per_g=16384.0)
    done = fltea_here("identify", path, "--for", "px4@300", "--inflate", "2")
    assert done.stderr == ""
    assert done.stdout.startswith("# PX4 (EKF2): noise at rest by fltea")
    assert "param set EKF2_ACC_NOISE" in done.stdout
    for wrong, why in (
        (["--for", "px3"], "Is px4 meant?"),
        (["--for", "px4@0"], "px4@300"),
        (["--for", "px4", "--json"], "nothing else"),
        (["--inflate", "2"], "--for"),
    ):
        done = fltea_here("identify", path, *wrong)
        assert (done.returncode, done.stdout) == (2, "")
        assert why in done.stderr
    done = fltea_here("identify", path, path, "--for", "px4")
    assert done.returncode == 2
    assert "single recording" in done.stderr


def test_nothing_is_printed_of_bad_data(tmp_path: Path) -> None:
    y = np.rint(16 * white(3000, 3, 1).T)
    y[:, 2] = 5
    y[1500:, 2] = 900
    path = npz(tmp_path / "bad.npz", np.repeat(y.astype(np.int32)[:1500], 2, axis=0))
    done = fltea_here("identify", path, "--for", "kalibr")
    assert (done.returncode, done.stdout) == (1, "")
    assert "withheld" in done.stderr


def test_programs_have_distinct_names() -> None:
    assert all(isinstance(one, Program) for one in PROGRAMS.values())
    assert len({one.title for one in PROGRAMS.values()}) == len(PROGRAMS)
