"""Tests of `fltea.open`: recordings, how they were read, and their results."""

import sys
from pathlib import Path
from types import SimpleNamespace

import fltea
import numpy as np
import pytest
from fltea.identification.load import Request, load
from fltea.recording.reading import Answer
from fltea.settings.how import How
from msgspec.structs import replace

from tests.rig.api_support import by_spectrum
from tests.rig.identify_files import LSB_PER_DPS, RATE_HZ, counts, identify_axis, npz


def test_a_recording_is_its_axes(tmp_path: Path) -> None:
    raw = counts(1500)
    found = fltea.open(npz(tmp_path / "a<b>.npz", raw), axes=["gyro_y", "gyro_x"])
    assert list(found) == ["gyro_y", "gyro_x"]
    np.testing.assert_array_equal(found["gyro_y"], raw[:, 1] / LSB_PER_DPS)
    assert (found.rate_hz, found.units["gyro_x"], found.counts.used) == (RATE_HZ, "deg/s", 1500)
    report = found.identify()
    alone = fltea.identify(found["gyro_x"], RATE_HZ, unit="deg/s", axis="gyro_x", lsb=1 / LSB_PER_DPS)
    # The axes of a file may share one size of the offset's random walk. So fields that depend on this size
    # may differ between an axis of a file and the same axis alone.
    of_walk = ("now", "walk", "filter", "text", "details", "allan", "allan_curve")
    by_walk = dict.fromkeys(of_walk)
    both = report["gyro_x"], alone
    assert replace(both[0], **by_walk) == replace(both[1], **by_walk)
    assert by_spectrum(both[0].details) == by_spectrum(both[1].details)
    assert both[0].allan_curve.B == both[1].allan_curve.B
    assert "a&lt;b&gt;.npz" in found._repr_html_()
    assert found.to_pandas().shape == (1500, 2)
    assert list(report.to_pandas().index) == ["gyro_y", "gyro_x"]
    with pytest.raises(KeyError, match="gyro_y, gyro_x"):
        _ = found["gyro_z"]


def test_all_stretches_count_and_time_goes_on_in_gaps(tmp_path: Path) -> None:
    """A gap of 300 samples makes two stretches without a gap. `fltea identify` reports the same."""
    raw, seq = counts(2500), np.arange(2500) + np.where(np.arange(2500) >= 1000, 300, 0)
    path = npz(tmp_path / "a.npz", raw, time_s=seq / RATE_HZ, seq=seq, accel_raw=raw, accel_lsb_per_g=16384.0)
    found = fltea.open(path)
    assert list(found)[3:] == ["accel_x", "accel_y", "accel_z"]
    assert (found.counts.used, found.counts.lost, found.units["accel_x"]) == (2500, 300, "m/s²")
    np.testing.assert_allclose(found.time_s, seq / RATE_HZ)
    y = load(Request((path,))).axes["gyro_x"]
    report = fltea.open(path, axes=["gyro_x"]).identify()
    own = identify_axis(y.y, 1 / RATE_HZ, y.lsb, None, y.gaps)
    assert by_spectrum(report["gyro_x"].details) == by_spectrum(own)
    assert "300 lost in 1 gaps" in found._repr_html_()


def test_a_recording_in_parquet(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow", reason="the extra notebook is not installed")
    found = fltea.open(npz(tmp_path / "a.npz", counts(600)))
    found.to_parquet(tmp_path / "a.parquet")
    table = pandas.read_parquet(tmp_path / "a.parquet")
    assert list(table.columns) == ["time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps"]
    np.testing.assert_array_equal(table["gyro_y_dps"], found["gyro_y"])
    np.testing.assert_allclose(np.diff(table["time_s"]), 1 / RATE_HZ)


def test_a_recording_tells_how_it_was_read_in_the_words_of_a_call(tmp_path: Path) -> None:
    loaded = load(Request((npz(tmp_path / "a.npz", counts(600)),)))
    said = (Answer("unit", "rad/s", "given", "--units"), Answer("columns", "gx, <b>", "stated", "the names"))
    found = fltea.Recording("a.npz", SimpleNamespace(**{**loaded._asdict(), "h": loaded.h, "reading": said}))
    assert [str(one) for one in found.reading] == ["rad/s (given: units)", "gx, <b> (stated: the names)"]
    shown = found._repr_html_()
    assert "<tr><th>unit</th><td>rad/s (given: units)</td></tr>" in shown
    assert "gx, &lt;b&gt; (stated" in shown


def test_what_a_call_says_of_a_recording_is_how_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Request] = []
    monkeypatch.setattr("fltea.api.recording.load", lambda one: asked.append(one) or load(Request(one.paths)))
    path = npz(tmp_path / "a.npz", counts(600))
    fltea.open(path, units="rad/s", accel_units="g", topic="1/2", overrule=True)
    fltea.open(path, columns=["a", 2], time_column=3, time_unit="ms", rate_hz=50)
    assert [one.how for one in asked] == [
        How(units="rad/s", accel_units="g", topic="1/2", overrule=True),
        How(columns=["a", "2"], time_column="3", time_unit="ms", rate_hz=50),
    ]


def test_a_library_that_is_missing_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = fltea.open(npz(tmp_path / "a.npz", counts(600)))
    for library, call in (
        ("pandas", found.to_pandas),
        ("pyarrow", lambda: found.to_parquet(tmp_path / "b.parquet")),
    ):
        monkeypatch.setitem(sys.modules, library, None)
        with pytest.raises(fltea.UsageError, match=f"{library}, which is not installed.*notebook"):
            call()
    assert not (tmp_path / "b.parquet").exists()


def test_a_recording_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(fltea.UsageError, match="no such file"):
        fltea.open(tmp_path / "none.npz")
    with pytest.raises(fltea.UsageError, match="accel_x"):
        fltea.open(npz(tmp_path / "a.npz", counts(600)), axes=["accel_x"])
    with pytest.raises(ValueError, match="sampling rate"):
        fltea.open(tmp_path / "a.csv", rate_hz=-1.0)
