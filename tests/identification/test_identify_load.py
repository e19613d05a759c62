"""Tests that recordings of every kind are read into axes, with the positions of missing samples."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.identification.load import Request, Unreadable, load, recordings
from fltea.records.errors import UsageError
from fltea.records.records import AnyRecord, Epoch, Sample
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.how import How

from tests.rig import mcap_support
from tests.rig.host_support import hello
from tests.rig.identify_files import LSB_PER_DPS, RATE_HZ, counts, npz


def test_npz_in_deg_per_s(tmp_path: Path) -> None:
    raw = counts(300)
    found = load(Request((npz(tmp_path / "a.npz", raw),)))
    assert list(found.axes) == ["gyro_x", "gyro_y", "gyro_z"]
    assert found.h == 0.01
    assert found.clock_ppm is None  # the clock's error is not known, because the file has no arrival times
    for i, series in enumerate(found.axes.values()):
        np.testing.assert_array_equal(series.y, raw[:, i] / LSB_PER_DPS)
        assert (series.unit, series.lsb) == ("deg/s", 1 / LSB_PER_DPS)
    assert found.counts.used == found.counts.samples == 300
    assert (found.counts.stretches, found.counts.lost) == (1, 0)
    assert not found.data_checks


def test_all_stretches(tmp_path: Path) -> None:
    """Three samples are missing after the first 100, and a restart follows 250 samples later.

    All stretches between these breaks are used and reported.
    """
    raw = counts(500)
    seq = np.arange(500) + np.where(np.arange(500) >= 100, 3, 0)
    epoch = np.where(np.arange(500) >= 350, 2, 1)
    path = npz(tmp_path / "a.npz", raw, time_s=seq / RATE_HZ, seq=seq, epoch=epoch)
    found = load(Request((path,)))
    one = found.axes["gyro_y"]
    np.testing.assert_array_equal(one.y, raw[:, 1] / LSB_PER_DPS)
    assert (one.gaps.at.tolist(), one.gaps.missing.tolist()) == ([100, 350], [3, 0])
    c = found.counts
    assert (c.samples, c.used, c.used_from, c.stretches) == (500, 500, 0, 3)
    assert (c.lost, c.gaps, c.bridged) == (3, 1, 3)
    (data_check,) = found.data_checks
    assert data_check.kind == "gaps"
    assert "500 of 500 samples, in 3 stretches, are used. 3 lost samples are filled in" in data_check.text


def test_so_many_short_gaps_are_bridged_by_nothing(tmp_path: Path) -> None:
    """Every fifth sample is lost. The gaps are not filled, because random samples would be a fifth of the
    record.
    """
    seq = np.arange(200) * 5 // 4
    path = npz(tmp_path / "a.npz", counts(200), time_s=seq / RATE_HZ, seq=seq)
    found = load(Request((path,)))
    assert (found.counts.used, found.counts.lost, found.counts.bridged) == (200, 49, 0)
    assert "drawn" not in found.data_checks[0].text


def test_csv_with_its_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = counts(120, 2)
    path.write_text("t,gx,gz\n" + "".join(f"{k},{a},{b}\n" for k, (a, b) in enumerate(rows.tolist())))
    found = load(Request((path,), None, How(columns=["gz"], units="lsb:16.4", rate_hz=50.0)))
    assert list(found.axes) == ["gyro_z"]
    assert found.h == 0.02
    np.testing.assert_allclose(found.axes["gyro_z"].y, rows[:, 1] / 16.4)
    assert found.axes["gyro_z"].lsb == pytest.approx(1 / 16.4)


@pytest.mark.parametrize("told", [True, False])
def test_ndjson_with_a_new_scale(told: bool, tmp_path: Path) -> None:
    """Samples of another measuring range form a stretch of their own (a run of samples that belong together),
    even if the file does not state a restart.
    """
    records: list[AnyRecord] = [hello()]
    for k in range(90):
        if k == 30:
            starts = 2 if told else 1
            records.append(hello(gyro_lsb_per_dps=131.0, sensor_starts=starts, host_ns=k * 10_000_000))
            records += [Epoch(2, "sensor_restart", k, k * 10_000, k * 10_000_000, 7, None)] * told
        lsb = 16.4 if k < 30 else 131.0
        rates = tuple(v / lsb for v in (k % 7, 3 - k % 5, k % 3))
        records.append(Sample(k, 1 + (k >= 30), k * 10_000, k * 10_000_000, rates, flags=2 if k == 40 else 0))
    path = tmp_path / "a.ndjson"
    path.write_bytes(b"".join(msgspec.json.encode(record) + b"\n" for record in records))
    found = load(Request((path,)))
    assert (found.counts.used, found.counts.used_from, found.counts.stretches) == (60, 30, 2)
    assert not len(found.axes["gyro_x"].gaps.at)
    assert "60 of 90 samples, in 2 stretches, are used. The others have another" in found.data_checks[0].text
    assert found.axes["gyro_x"].lsb == 1 / 131
    assert (found.counts.late, found.counts.retried, found.counts.saturated) == (0, 1, 0)


def test_mcap_session(tmp_path: Path) -> None:
    """Frames 60, 61 and 150 of 400 are lost. The file and its folder give the same result."""
    mcap_support.record(tmp_path / "rec", mcap_support.transport(400))
    found = load(Request((tmp_path / "rec",)))
    assert found.counts.lost == 3
    assert (found.counts.used, found.counts.bridged) == (397, 3)
    assert found.axes["gyro_x"].gaps.at.tolist() == [60, 148]
    assert found.hello.device_id is not None
    ((only,),) = recordings([tmp_path / "rec"])
    again = load(Request((only,)))
    np.testing.assert_array_equal(found.axes["gyro_z"].y, again.axes["gyro_z"].y)


def test_a_session_of_a_device_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    mcap_support.record(tmp_path / "rec", mcap_support.transport(400, contradicting=400))
    with pytest.raises(UsageError, match=r"HELLO states 200 Hz, .* samples come at 100 Hz"):
        load(Request((tmp_path / "rec",)))


def test_a_session_of_a_device_that_contradicted_itself_for_a_while_has_a_warning(tmp_path: Path) -> None:
    """HELLO states twice the true rate for 3 s, and the true rate for 9 s."""
    mcap_support.record(tmp_path / "rec", mcap_support.transport(1200, contradicting=300))
    found = load(Request((tmp_path / "rec",)))
    (warning,) = (one for one in found.data_checks if one.kind == "rate_differs")
    assert "HELLO states 200 Hz" in warning.text
    assert found.hello.rate_hz == 100
    assert found.counts.used >= 800
    assert found.counts.rate_differs >= 150
    # Frames 60, 61 and 150 were lost while HELLO stated a wrong rate. Sequence numbers are not used during
    # that time, so these three frames are in neither count.
    assert found.counts.samples + found.counts.rate_differs == 1200 - 3


def test_accelerometer_on_request(tmp_path: Path) -> None:
    accel = counts(200, 3, seed=2)
    path = npz(tmp_path / "a.npz", counts(200), accel_raw=accel, accel_lsb_per_g=16384.0)
    assert "accel_x" not in load(Request((path,))).axes
    found = load(Request((path,), ("accel_z", "gyro_x")))
    assert list(found.axes) == ["accel_z", "gyro_x"]
    one = found.axes["accel_z"]
    np.testing.assert_allclose(one.y, accel[:, 2] * STANDARD_GRAVITY_MS2 / 16384)
    assert one.unit == "m/s²"
    assert one.lsb == pytest.approx(STANDARD_GRAVITY_MS2 / 16384)


def test_clock_against_arrivals(tmp_path: Path) -> None:
    """The device states a rate of 100 Hz, but its samples arrive at 99 Hz."""
    path = npz(tmp_path / "a.npz", counts(2000), t_host_s=np.arange(2000) / 99)
    found = load(Request((path,)))
    assert found.clock_ppm == pytest.approx(-10_000, rel=0.05)
    assert [data_check.kind for data_check in found.data_checks] == ["sample rate"]


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (Request((Path("none.npz"),)), "no such file"),
        (Request((Path("a.npz"),), ("gyro_x", "accel_y")), "has no accel_y"),
        (Request((Path("a.npz"),), how=How(rate_hz=100.0)), "--rate is not for"),
        (Request((Path("a.csv"),), how=How(columns=["gx"], units="furlong")), "not a unit"),
    ],
)
def test_refuses(request_: Request, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    npz(tmp_path / "a.npz", counts(100))
    (tmp_path / "a.csv").write_text("gx\n1\n")
    with pytest.raises(UsageError, match=message):
        load(request_)


def test_what_is_no_recording_stays_apart(tmp_path: Path) -> None:
    for device in ("one", "two"):
        mcap_support.record(tmp_path / "rec", mcap_support.transport(30), device=device)
    files = sorted((tmp_path / "rec").glob("*.mcap"))
    found = recordings(
        [tmp_path / "a.npz", files[0], tmp_path / "nothing.mcap", files[1], tmp_path / "b.csv"]
    )
    bad = found[2]
    assert isinstance(bad, Unreadable)
    assert bad.name.endswith("nothing.mcap")
    assert [one for one in found if one is not bad] == [
        (tmp_path / "a.npz",),
        (files[0],),
        (files[1],),
        (tmp_path / "b.csv",),
    ]
