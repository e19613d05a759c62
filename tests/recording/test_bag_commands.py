"""Tests the commands that read recordings with bags of ROS."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from fltea.archive.export import export
from fltea.archive.info import as_text, sessions, summarise
from fltea.identification.load import Request, load, recordings
from fltea.recording.npz_file import open_npz
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource

from tests.rig.bag_support import KINDS, Messages, even, write_bag
from tests.rig.host_support import fltea_here

N = 1200


@pytest.mark.parametrize("kind", KINDS)
def test_info_and_export(tmp_path: Path, kind: str) -> None:
    rest = even(N)
    lost = np.delete(np.arange(N), [500, 501])
    some = rest.rows(lost)
    path = write_bag(tmp_path / f"a.{kind}", {"/imu": some, "/other": even(20)})
    summary = summarise([path], 100, how=How(topic="/imu"))
    counts = summary.counts
    assert (counts.delivered, counts.lost, counts.gaps, summary.whole) == (N - 2, 2, 1, True)
    assert summary.rate_hz == pytest.approx(200, rel=1e-6)
    text = as_text(summary)
    assert "2023-11-14 22:13:20 UTC" in text
    assert "topic /imu, sensor_msgs/" in text
    assert "other topics: /other" in text
    out = tmp_path / "out.npz"
    assert export([path], out, "samples", 100, how=How(topic="/imu")).rows == N - 2
    again = open_npz(out).whole()
    np.testing.assert_allclose(np.radians(again.gyro), some.gyro_rads, rtol=1e-14)
    np.testing.assert_array_equal(again.accel_ms2, some.accel_ms2)


def test_identify_has_the_unit_of_acceleration_and_data_checks_of_the_bag(
    tmp_path: Path,
) -> None:
    rest = even(N)
    path = write_bag(tmp_path / "a.bag", {"/imu": rest._replace(stamp_ns=[0] * N, arrival_ns=rest.stamp_ns)})
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    loaded = load(Request((path,), ("gyro_x", "accel_z")))
    assert {"bag_stamps", "cut_recording"} <= {data_check.kind for data_check in loaded.data_checks}
    accel = loaded.axes["accel_z"]
    assert (accel.unit, accel.lsb) == ("m/s²", None)
    assert np.mean(accel.y) == pytest.approx(9.81, rel=1e-3)
    summary = summarise([path], 100)
    assert not summary.whole
    assert len(summary.notes) == 2


def test_clocks_that_go_at_different_rates_are_a_data_check(tmp_path: Path) -> None:
    rest = even(N, 50.0)
    # the arrival times are 1 % farther apart than the stamps
    late = (np.array(rest.stamp_ns) + np.arange(N) * 200_000).tolist()
    loaded = load(Request((write_bag(tmp_path / "a.bag", {"/imu": rest._replace(arrival_ns=late)}),)))
    assert loaded.clock_ppm == pytest.approx(-9900, rel=0.02)
    assert "sample rate" in {data_check.kind for data_check in loaded.data_checks}


def test_several_bags_are_several_recordings(tmp_path: Path) -> None:
    paths = [write_bag(tmp_path / f"{i}.{kind}", {"/imu": even(30)}) for i, kind in enumerate(KINDS)]
    assert recordings(paths) == [(path,) for path in paths]
    assert recordings([tmp_path]) == [(path,) for path in sorted(paths)]
    assert sessions([tmp_path]) == [[path] for path in sorted(paths)]
    (file,) = paths[2].glob("*.mcap")
    (tmp_path / "loose").mkdir()
    loose = [tmp_path / "loose" / name for name in ("a.mcap", "b.mcap")]
    for one in loose:
        one.write_bytes(file.read_bytes())
    assert recordings([tmp_path / "loose"]) == [(one,) for one in loose]


def test_a_folder_of_bags_is_no_recording(tmp_path: Path) -> None:
    for kind in KINDS:
        write_bag(tmp_path / f"a.{kind}", {"/imu": even(30)})
    with pytest.raises(UsageError, match=r"folder of 3 bags; name one of them: a\.bag, a\.db3, a\.mcap"):
        ReplaySource(tmp_path)


def test_a_bag_in_several_files(tmp_path: Path) -> None:
    rest = even(60)
    folder = tmp_path / "long"
    folder.mkdir()
    for number, begin in ((0, 0), (1, 20), (10, 40)):
        topics = {"/imu": rest.rows(slice(begin, begin + 20))}
        (file,) = write_bag(tmp_path / "one.mcap", topics).glob("*.mcap")
        file.rename(folder / f"long_{number}.mcap")
    whole = open_bag(folder).whole()
    np.testing.assert_allclose(np.radians(whole.gyro), rest.gyro_rads, rtol=1e-14)
    (folder / "long_1.mcap").write_bytes(b"no bag at all")
    stored = open_bag(folder)
    assert (stored.samples, [note.kind for note in stored.notes]) == (40, ["recording_gap"])


def of_two_files(folder: Path, kind: str, topics: Sequence[Messages]) -> list[Path]:
    """Write a bag that consists of two files, each with the same messages."""
    folder.mkdir()
    names = [folder / f"long_{number}.{kind}" for number in range(len(topics))]
    for name, messages in zip(names, topics, strict=True):
        (file,) = write_bag(folder.parent / f"one.{kind}", {"/imu": messages}).glob(f"*.{kind}")
        file.rename(name)
    return names


@pytest.mark.parametrize("how", ["copied", "linked", "symlinked", "overlapping"])
@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_messages_in_two_files_of_a_bag_count_once(kind: str, how: str, tmp_path: Path) -> None:
    rest, folder = even(60), tmp_path / "long"
    if how == "overlapping":
        of_two_files(folder, kind, [rest.rows(slice(0, 40)), rest.rows(slice(25, 60))])
    else:
        (first,) = of_two_files(folder, kind, [rest])
        second = folder / f"long_1.{kind}"
        {"copied": shutil.copy, "linked": os.link, "symlinked": os.symlink}[how](first, second)
    stored = open_bag(folder)
    np.testing.assert_allclose(np.radians(stored.whole().gyro), rest.gyro_rads, rtol=1e-14)
    (note,) = stored.notes
    assert note.kind == "bag_messages"
    twice = {"copied": 60, "overlapping": 15}
    expected = f"{twice[how]} messages stand in the bag twice" if how in twice else "is the same file as"
    assert expected in note.text


@pytest.mark.parametrize("stamped", [True, False])
def test_messages_that_only_have_the_times_of_others_are_no_copies(stamped: bool, tmp_path: Path) -> None:
    """A message counts as a copy, and is left out, only if its time and its numbers are those of an earlier
    one.

    With stamps: the sensor's clock begins again in the second file, so the stamps repeat, but the numbers are
    others. No message is left out.

    Without stamps: the second file repeats the arrival times and the numbers of the first. Its messages are
    left out.
    """
    rest = even(60)
    if stamped:
        again = even(60, seed=2)._replace(arrival_ns=[ns + 10**9 for ns in rest.stamp_ns])
    else:
        rest = rest._replace(stamp_ns=[0] * 60, arrival_ns=rest.stamp_ns)
        again = rest
    of_two_files(tmp_path / "long", "mcap", [rest, again])
    assert open_bag(tmp_path / "long").samples == (120 if stamped else 60)


def test_a_bag_in_run(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.db3", {"/a": even(N), "/b": even(N, seed=2)})
    flags = ("--once", "--format", "none", "--window", "50", "--startup", "100")
    assert "which of its 2 Imu topics is meant" in fltea_here("run", "-s", f"replay:{path}", *flags).stderr
    found = fltea_here("run", "-s", str(path), "--topic", "/b", "--shuffle", "3", *flags)
    assert found.returncode == 0, found.stderr
