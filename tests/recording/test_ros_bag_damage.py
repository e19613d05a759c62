"""If a ROS bag is too large, truncated or changed, its intact parts are read, or an error says why not."""

import contextlib
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from fltea.records.events import RawBlock, Trouble
from fltea.settings.how import How
from fltea.settings.limits import Limits
from fltea.sources.replay import ReplaySource
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.bag_support import KINDS, even, told, write_bag
from tests.rig.hostile_files import Files, zeros
from tests.rig.hostile_sqlite import ENDLESS_TREE, HOSTILE

N = 900


def test_more_than_the_limit_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/imu": even(3000)})
    with pytest.raises(UsageError, match=r"replay\.max_mb"):
        open_bag(path, limits=Limits(max_mb=0.1))
    with pytest.raises(UsageError, match=r"replay\.max_chunk_mb"):
        open_bag(path, limits=Limits(max_chunk_mb=0.1))
    packed = write_bag(tmp_path / "b.bag", {"/imu": even(3000)}, packed="bz2")
    with pytest.raises(UsageError, match=r"replay\.max_chunk_mb"):
        open_bag(packed, limits=Limits(max_chunk_mb=0.5))


def test_what_is_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    for data in (b"", b"hello", b"#ROSBAG V1.2\n"):
        path.write_bytes(data)
        with pytest.raises(UsageError, match=r"a\.bag: cannot be read as a bag \(it"):
            open_bag(path)


def test_other_files_of_sqlite(tmp_path: Path) -> None:
    path = tmp_path / "empty.db3"
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.executescript("CREATE TABLE words(id)")
    with pytest.raises(UsageError, match="it has no table topics"):
        open_bag(path)
    path = write_bag(tmp_path / "odd.db3", {"/imu": even(30)})
    (file,) = path.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("UPDATE messages SET timestamp = 'soon' WHERE id = 3")
        connection.execute("UPDATE messages SET data = 'words' WHERE id = 4")
        connection.execute("UPDATE messages SET data = zeroblob(200000) WHERE id = 5")
        connection.execute("INSERT INTO topics SELECT 9, name, type, 'json', '', '' FROM topics")
    stored = open_bag(path)
    assert stored.samples == 28
    assert "2 messages do not have the layout" in told(stored)["bag_messages"]
    with pytest.raises(UsageError, match="no Imu messages of the topic '/other'"):
        open_bag(path, How(topic="/other"))


@pytest.mark.parametrize("name", HOSTILE)
def test_files_of_sqlite_that_compute_without_end(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    HOSTILE[name](path)
    assert path.stat().st_size < 30_000
    refused = r"has no table (topics|messages)|columns of its table messages are computed"
    with pytest.raises(UsageError, match="processor time" if name == ENDLESS_TREE else refused):
        open_bag(path, limits=Limits(seconds=0.1))


def test_a_packed_bag_unpacks_to_no_more_than_a_recording_does(tmp_path: Path) -> None:
    path = tmp_path / "a.db3.zstd"
    path.write_bytes(zeros("zstd", 50_000_000))
    with pytest.raises(UsageError, match=rf"more than 200 times its size of {path.stat().st_size} bytes"):
        open_bag(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def whole_files(folder: Path) -> Files:
    found = Files()
    for kind in KINDS:
        topics = {"/imu": even(N)}
        path = write_bag(folder / f"rest.{kind}", topics, words=["/chatter"], chunk_bytes=60_000)
        file = path if path.is_file() else next(path.glob(f"*.{kind}"))
        found[kind] = file.read_bytes()
    found["lz4"] = write_bag(folder / "packed.bag", {"/imu": even(N)}, packed="lz4").read_bytes()
    return found


def read_anything(path: Path, data: bytes) -> Any:
    """Return the recording in a file with these bytes, or None if the file is refused with a message."""
    path.write_bytes(data)
    try:
        source = ReplaySource(path, limits=Limits(max_chunk_mb=1, max_mb=1))
    except UsageError:
        return None
    return list(source.events())


@pytest.mark.parametrize("kind", [*KINDS, "lz4"])
@given(share=st.floats(0, 1))
@settings(max_examples=25)
def test_a_bag_that_is_cut_gives_what_it_holds(
    kind: str, share: float, whole_files: Files, folder: Path
) -> None:
    data = whole_files[kind]
    size = int(share * (len(data) - 1))
    events = read_anything(folder / f"cut.{'bag' if kind == 'lz4' else kind}", data[:size])
    if events is None:
        # these bags have a single chunk, which is truncated, so nothing is left
        assert share < 0.5 or kind in ("mcap", "lz4")
        return
    troubles = [event for event in events if isinstance(event, Trouble)]
    assert "cut_recording" in {event.kind for event in troubles}
    blocks = [event for event in events if isinstance(event, RawBlock)]
    rows = np.concatenate([block.gyro for block in blocks])
    # if a page of a database is cut in half, only its later rows remain, so rows are found by their numbers
    number = np.concatenate([block.sequence for block in blocks])
    np.testing.assert_allclose(np.radians(rows), np.asarray(even(N).gyro_rads)[number], rtol=1e-14)
    if kind == "bag":
        assert len(rows) > 0.8 * share * N - 60


def test_a_bag_without_its_index_was_not_closed(whole_files: Files, tmp_path: Path) -> None:
    data = whole_files["bag"]
    index = int.from_bytes(data[data.index(b"index_pos=") + 10 :][:8], "little")
    for end in (index, data.rindex(b"chunk_pos=") - 20, len(data) - 1):
        events = read_anything(tmp_path / "a.bag", data[:end])
        assert sum(len(event.gyro) for event in events if isinstance(event, RawBlock)) == N
        assert [event.kind for event in events if isinstance(event, Trouble)] == ["cut_recording"]
    never_closed = data[:index].replace(b"index_pos=" + index.to_bytes(8, "little"), b"index_pos=" + bytes(8))
    assert len(read_anything(tmp_path / "b.bag.active", never_closed)) > 1


@pytest.mark.parametrize("kind", [*KINDS, "lz4"])
@given(places=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=6))
@settings(max_examples=25)
def test_bags_that_were_changed_anywhere(
    kind: str, places: list[tuple[float, int]], whole_files: Files, folder: Path
) -> None:
    data = bytearray(whole_files[kind])
    for share, value in places:
        data[int(share * (len(data) - 1))] = value
    read_anything(folder / f"changed.{'bag' if kind == 'lz4' else kind}", bytes(data))


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.binary(max_size=300), begin=st.integers(0, 200))
@settings(max_examples=25)
def test_any_bytes(kind: str, data: bytes, begin: int, whole_files: Files, folder: Path) -> None:
    read_anything(folder / f"any.{kind}", whole_files[kind][:begin] + data)


@pytest.mark.parametrize("left", [0.5, 0.9])
def test_a_packed_bag_that_is_cut_is_told_under_its_own_name(left: float, tmp_path: Path) -> None:
    """It is decompressed to a temporary file, whose name tells nothing."""
    (path,) = write_bag(tmp_path / "rest.db3", {"/imu": even(N)}, packed="file").glob("*.zstd")
    cut = tmp_path / "cut.db3.zstd"
    cut.write_bytes(path.read_bytes()[: int(path.stat().st_size * left)])
    found = open_bag(cut)
    assert found.samples > 100
    assert all(note.text.startswith(f"{cut}: ") for note in found.notes)
    assert f"{cut}: is cut off; what can be decompressed is read." in [note.text for note in found.notes]


def test_a_packed_bag_of_which_nothing_is_left_says_that_it_is_cut(tmp_path: Path) -> None:
    (path,) = write_bag(tmp_path / "rest.db3", {"/imu": even(N)}, packed="file").glob("*.zstd")
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(UsageError, match=r"zstd: cannot be read as a bag \(it is cut off before anything"):
        open_bag(path)
