"""Tests that the axes of a sensor share one random walk of the offset if their data agree."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.api.recording import open as open_recording
from fltea.identification.axis_report import AxisReport
from fltea.identification.conclusions import in_agreement
from fltea.identification.forecast_judge import FittedSystem, fitted_system
from fltea.identification.load import Request
from fltea.identification.run import identify_all
from fltea.identification.shared_walk import shared_walk
from fltea.identification.workers import Here
from fltea.noise.parts import Walk, White
from fltea.records.arrays import Array
from fltea.settings.how import How

from tests.rig.identify_files import settings
from tests.rig.identify_support import gauss_markov

H, N = 0.01, 30_000


def axes(shares: tuple[float, ...], seed: int) -> dict[str, Array]:
    rng = np.random.default_rng((seed, 7))
    return {
        f"gyro_{axis}": rng.normal(size=N) * 0.1 + np.cumsum(rng.normal(size=N)) * np.sqrt(share) * 0.1 / N
        for axis, share in zip("xyz", shares, strict=True)
    }


def mean_step(one: FittedSystem) -> float:
    return float(one.walk.weights @ one.walk.steps)


@pytest.mark.slow
def test_together_they_know_their_walk_better() -> None:
    """Three axes together give a smaller error of K than each alone, by a factor of about √3."""
    off: dict[str, list[float]] = {"own": [], "shared": []}
    for seed in range(15):
        own = {name: fitted_system([White(0.01)], y, H) for name, y in axes((300.0,) * 3, seed).items()}
        shared = shared_walk(own, H)
        if shared["gyro_x"] is own["gyro_x"]:
            continue
        for kind, found in (("own", own), ("shared", shared)):
            off[kind] += [np.log(max(mean_step(one) * N * N / 0.01, 1.0) / 300.0) for one in found.values()]
    own_rms, shared_rms = (np.sqrt(np.mean(np.square(off[kind]))) for kind in ("own", "shared"))
    assert len(off["shared"]) >= 36
    assert shared_rms < 0.7 * own_rms


def test_axes_that_differ_have_a_walk_of_their_own() -> None:
    own = {name: fitted_system([White(0.01)], y, H) for name, y in axes((0.0, 0.0, 3000.0), 1).items()}
    assert shared_walk(own, H) == own


def test_axes_whose_parts_walk_have_nothing_but_bounds_in_common() -> None:
    """Each axis has a relaxation of 15 s, of a different size on each axis.

    In five minutes, one axis alone may not show that this is no random walk. All axes together show it.
    """
    rng = np.random.default_rng(5)
    own, bounded = {}, {"own": 0.0, "shared": 0.0}
    for axis, size in zip("xyz", (0.05, 0.07, 0.1), strict=True):
        y = rng.normal(size=N) * 0.1 + gauss_markov(rng, N, H, size, 15.0)
        own[f"gyro_{axis}"] = fitted_system([White(0.01), Walk(size * np.sqrt(2 / 15.0))], y, H)
    shared = shared_walk(own, H)
    for kind, found in (("own", own), ("shared", shared)):
        bounded[kind] = min(one.walk.weights[np.isfinite(one.walk.taus)].sum() for one in found.values())
    assert bounded["shared"] > max(0.9, bounded["own"])
    by_tau = [
        [one.walk.weights[one.walk.taus == tau].sum() for tau in np.unique(one.walk.taus)]
        for one in shared.values()
    ]
    np.testing.assert_allclose(by_tau, [by_tau[0]] * 3)
    for name in own:
        np.testing.assert_array_equal(shared[name].walk.steps, own[name].walk.steps)


def test_one_axis_and_axes_that_are_not_alike_stay_as_they_are() -> None:
    y = axes((300.0,) * 3, 2)
    walking = {"gyro_y": fitted_system([White(0.01), Walk(0.003)], y["gyro_y"], H)}
    alone = {"gyro_x": fitted_system([White(0.01)], y["gyro_x"], H)}
    assert shared_walk(alone, H) == alone
    mixed = walking | {name: fitted_system([White(0.01)], y[name], H) for name in ("gyro_x", "gyro_z")}
    assert shared_walk(mixed, H)["gyro_y"] is walking["gyro_y"]


def test_sensors_are_kept_apart() -> None:
    y = axes((300.0,) * 3, 2)
    own = {name: fitted_system([White(0.01)], one, H) for name, one in y.items()}
    found = in_agreement({"gyro_x": own["gyro_x"], "accel_x": own["gyro_y"], "gyro_y": None}, H)
    assert found == {"gyro_x": own["gyro_x"], "accel_x": own["gyro_y"]}


@pytest.mark.parametrize("channels", [None, ("gyro_x", "gyro_z")])
def test_all_that_is_said_of_a_recording_goes_by_it(channels: tuple[str, ...] | None, tmp_path: Path) -> None:
    y = axes((300.0,) * 3, 3)
    names = channels or tuple(y)
    columns = ",".join(f"{name}_dps" for name in names)
    rows = np.column_stack([y[name] for name in names])
    np.savetxt(tmp_path / "a.csv", rows, "%.9g", ",", header=columns, comments="")
    (report,) = identify_all(
        [Request((tmp_path / "a.csv",), how=How(rate_hz=100.0))], settings(shuffles=0), Here()
    )
    found = [axis for axis in report.axes.values() if isinstance(axis, AxisReport)]
    assert len(found) == len(names)
    K = found[0].model.offset_walk
    assert K > 0
    assert [axis.model.offset_walk for axis in found] == pytest.approx([K] * len(found), rel=1e-9)
    first = found[0].model.offset_relaxation
    for axis in found:
        # all axes have the same relaxation, except for rounding errors in its last bits
        relaxation = axis.model.offset_relaxation
        assert (relaxation is None) == (first is None)
        if relaxation is not None and first is not None:
            assert msgspec.structs.astuple(relaxation) == pytest.approx(
                msgspec.structs.astuple(first), rel=1e-9
            )
        assert axis.filter is not None
        assert axis.filter.K > 0
        assert axis.now is not None
        for told in axis.filter.heading_std:
            assert told.filter == pytest.approx(told.forecast, rel=0.05)
    again = open_recording(tmp_path / "a.csv", rate_hz=100.0).identify()
    for one, axis in zip(again.values(), found, strict=True):
        assert (one.now, one.filter, one.walk) == (axis.now, axis.filter, axis.walk)
