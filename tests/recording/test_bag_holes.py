"""In bags with compressed chunks, damage costs only the chunk that it is in, wherever it is."""

import io
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.recovery import recover
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from tests.rig.bag_support import even, told, write_bag

N, CHUNK_BYTES = 400, 12_000
MESSAGES = even(N)
PACKED = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}


class Bag:
    """A bag in several chunks. `chunks`: of each chunk the begin, the begin of its data, and the end."""

    def __init__(self, data: bytes, name: str) -> None:
        self.data, self.name = data, name
        self.chunks = [*(ros1_chunks(data) if name.endswith(".bag") else mcap_chunks(data))]
        assert len(self.chunks) > 4


def ros1_chunks(data: bytes) -> Iterator[tuple[int, int, int]]:
    at = len("#ROSBAG V2.0\n")
    while at < len(data):
        (head,) = struct.unpack_from("<I", data, at)
        begin = at + 4 + head + 4
        end = begin + struct.unpack_from("<I", data, begin - 4)[0]
        if b"op=\x05" in data[at:begin]:
            yield at, begin, end
        at = end


def mcap_chunks(data: bytes) -> Iterator[tuple[int, int, int]]:
    at = 8
    while at < len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        if kind == Opcode.CHUNK:
            yield at, at + 9 + 48, at + 9 + length
        at += 9 + length


def in_chunks(data: bytes, compression: CompressionType) -> bytes:
    """Return an MCAP file with the same messages in compressed chunks."""
    out = io.BytesIO()
    writer, channels = Writer(out, compression=compression, chunk_size=CHUNK_BYTES), dict[int, int]()
    writer.start(profile="ros2")
    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages():
        assert schema is not None
        if channel.id not in channels:
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
        times = message.log_time, message.publish_time
        writer.add_message(channels[channel.id], times[0], message.data, times[1], message.sequence)
    writer.finish()
    return out.getvalue()


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Bag]:
    folder = tmp_path_factory.mktemp("bags")
    found = {}
    for packed in ("lz4", "bz2"):
        path = write_bag(folder / f"{packed}.bag", {"/imu": MESSAGES}, packed=packed, chunk_bytes=CHUNK_BYTES)
        found[path.name] = Bag(path.read_bytes(), "rest.bag")
    (path,) = write_bag(folder / "plain.mcap", {"/imu": MESSAGES}).glob("*.mcap")
    for name, compression in PACKED.items():
        found[f"{name}.mcap"] = Bag(in_chunks(path.read_bytes(), compression), "rest.mcap")
    return found


def damaged(bag: Bag, place: int, how: str) -> bytes:
    """Return the bag with damage in one of its chunks."""
    data = bag.data
    at, begin, end = bag.chunks[place]
    match how:
        case "other bytes":
            return data[: begin + 30] + b"\x55" * 400 + data[begin + 430 :]
        case "hole":
            return data[: begin + 100] + data[begin + 300 :]
        case "zeros":
            return data[: at + 9] + bytes(end - 50 - at - 9) + data[end - 50 :]
        case "zeros from the head on":
            return data[:at] + bytes(end - 50 - at) + data[end - 50 :]
    return data[: at + 1] + b"\xff\xff\x10" + data[at + 4 :]


def read(folder: Path, name: str, data: bytes) -> Stored:
    path = folder / name
    path.write_bytes(data)
    return open_bag(path)


BAGS = "lz4.bag", "bz2.bag", "zstd.mcap", "lz4.mcap"
HOW = "other bytes", "hole", "zeros", "zeros from the head on", "length"


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("place", [0, 2], ids=["first", "middle"])
@pytest.mark.parametrize("name", BAGS)
def test_damage_costs_one_chunk(
    name: str, place: int, how: str, bags: dict[str, Bag], tmp_path: Path
) -> None:
    """The descriptions of topics, which are in the first chunk, are also in the index at the end."""
    bag = bags[name]
    found = read(tmp_path, bag.name, damaged(bag, place, how))
    gyro = np.degrees(np.asarray(MESSAGES.gyro_rads))
    rows = found.whole().gyro
    lost = N - len(rows)
    if how == "length" and name.endswith(".mcap"):  # another field of the chunk has its length, too
        assert (lost, "these are read" in told(found)["cut_recording"]) == (0, True)
        return
    assert 0 < lost < 2 * N / len(bag.chunks)
    first = (
        0
        if place == 0
        else int(np.argmax(np.any(np.abs(rows[: N - lost] - gyro[: N - lost]) > 1e-9, axis=1)))
    )
    np.testing.assert_allclose(rows, np.delete(gyro, slice(first, first + lost), axis=0), rtol=1e-12)
    assert "recording_gap" in told(found)
    assert "cut_recording" not in told(found)


@pytest.mark.parametrize("name", BAGS)
def test_messages_whose_topic_is_described_nowhere_are_counted(
    name: str, bags: dict[str, Bag], tmp_path: Path
) -> None:
    """Without an index, only the damaged chunk described the topic. That there is none would be untrue."""
    bag = bags[name]
    data = damaged(bag, 0, "other bytes")[: bag.chunks[-1][2]]
    with pytest.raises(
        UsageError, match=r"no messages of this bag can be read.* \d+ messages are left out: the"
    ):
        read(tmp_path, bag.name, data)


def test_the_index_is_found_where_bytes_before_it_are_missing(bags: dict[str, Bag], tmp_path: Path) -> None:
    """Then each offset in the file is wrong by as many bytes."""
    path = tmp_path / "rest.mcap"
    path.write_bytes(damaged(bags["zstd.mcap"], 0, "hole"))
    done = recover(path, in_place=False)
    assert done.out is not None
    assert done.messages == open_bag(path).samples == open_bag(done.out).samples > N / 2


def test_a_damaged_message_is_not_read_with_bytes_of_the_next_one(tmp_path: Path) -> None:
    """A chunk that is not compressed is read on after a hole in it."""
    path = write_bag(tmp_path / "rest.bag", {"/imu": MESSAGES}, chunk_bytes=CHUNK_BYTES)
    bag = Bag(path.read_bytes(), "rest.bag")
    _, begin, end = bag.chunks[2]
    middle = (begin + end) // 2
    found = read(tmp_path, "hole.bag", bag.data[:middle] + bag.data[middle + 40 :])
    rows, gyro = found.whole().gyro, np.degrees(np.asarray(MESSAGES.gyro_rads))
    assert N - 2 <= len(rows) < N
    assert np.isclose(rows[:, np.newaxis], gyro, rtol=1e-12).all(axis=2).any(axis=1).all()
