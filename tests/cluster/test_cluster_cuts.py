"""Large files are cut into pieces. Each piece is a recording, and the samples of all pieces, in order, are
those of the whole file.
"""

import contextlib
import io
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pyarrow as pa
import pytest
from fltea.cluster.cut import even_pieces
from fltea.cluster.listing import files_of
from fltea.cluster.pieces import cuts_of, write_piece
from fltea.cluster.whole import Ask
from fltea.identification.load import Loaded, load
from fltea.records.errors import UsageError
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.wire_events import WireEvents
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet

from tests.rig.bag_support import even, write_bag, write_mcap
from tests.rig.cluster_support import ASK
from tests.rig.mcap_support import sink_in, transport
from tests.rig.tiers import slow

N = 3000
GYRO = np.round(np.random.default_rng(5).normal(0.1, 0.05, (N, 3)), 5)
TIMES = np.arange(N) / 100
HOW = How(units="deg/s", rate_hz=100.0)


def npy(folder: Path) -> Path:
    np.save(folder / "a.npy", GYRO)
    return folder / "a.npy"


def npy_with_fields(folder: Path) -> Path:
    columns = {"time_s": TIMES, **{f"gyro_{axis}": GYRO[:, i].astype("f4") for i, axis in enumerate("xyz")}}
    table = np.empty(len(TIMES), dtype=[(name, one.dtype) for name, one in columns.items()])
    for name, one in columns.items():
        table[name] = one
    np.save(folder / "f.npy", table)
    return folder / "f.npy"


def csv(folder: Path, end: str = "\n") -> Path:
    head = f"# a logger{end}time_s,gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s]{end}"
    lines = [",".join(map(repr, [t, *row])) for t, row in zip(TIMES.tolist(), GYRO.tolist(), strict=True)]
    (folder / "a.csv").write_bytes((head + end.join(lines)).encode())
    return folder / "a.csv"


def csv_of_windows(folder: Path) -> Path:
    return csv(folder, "\r\n")


def table(folder: Path) -> Path:
    columns = {f"gyro_{axis}": GYRO[:, i] for i, axis in enumerate("xyz")}
    parquet.write_table(pa.table({"time_s": TIMES, **columns}), folder / "a.parquet", row_group_size=250)
    return folder / "a.parquet"


def ros1(folder: Path) -> Path:
    return write_bag(folder / "a.bag", {"/imu": even(N // 3)}, packed="lz4", chunk_bytes=20_000)


def ros2(folder: Path) -> Path:
    return write_mcap(folder / "b.mcap", even(N // 3), chunk_size=20_000)


def ours(folder: Path) -> Path:
    """Make a recording as the daemon does."""
    sink = sink_in(folder / "rec")
    wire = WireEvents("/dev/due")
    for number, item in enumerate(transport(900, boots=2)):
        sink.write(item)
        for event in wire.feed(item, item.host_ns):
            if isinstance(event, Hello):
                sink.write(event)
        if number % 100 == 50:
            # this ends a chunk; the daemon ends one after a second or a megabyte
            sink._part.flush(sink._part.flushed_ns)
    sink.close()
    (path,) = (folder / "rec").glob("*.mcap")
    return path


UNITS = {
    npy: HOW,
    csv: How(),
    csv_of_windows: How(),
    table: How(units="deg/s"),
    npy_with_fields: How(units="deg/s"),
}
BLOCKS = {ros1: 40_000, ours: 12_000}


def ask_of(make: Callable[[Path], Path], block_bytes: int | None = None) -> Ask:
    return msgspec.structs.replace(
        ASK, how=UNITS.get(make, How()), block_bytes=block_bytes or BLOCKS.get(make, 20_000)
    )


def cut_up(make: Callable[[Path], Path], folder: Path) -> tuple[Loaded, list[Loaded]]:
    """Return a recording as a whole and in three or more pieces, none of which is reported as cut off."""
    ask = ask_of(make)
    (file,) = files_of([str(make(folder))])
    pieces = []
    for number, cut in enumerate(cuts_of(file, ask)):
        (folder / str(number)).mkdir()
        pieces.append(load(ask.request(write_piece(file, cut, folder / str(number)))))
    assert len(pieces) >= 3
    assert not any(data_check.kind == "cut_recording" for one in pieces for data_check in one.data_checks)
    return load(ask.request(Path(file.path))), pieces


@pytest.mark.parametrize("make", [npy, npy_with_fields, csv, csv_of_windows, slow(table), ros1, ros2])
def test_all_samples_once(make: Callable[[Path], Path], tmp_path: Path) -> None:
    whole, pieces = cut_up(make, tmp_path)
    for name, series in whole.axes.items():
        np.testing.assert_array_equal(np.concatenate([one.axes[name].y for one in pieces]), series.y)
        assert all(one.axes[name].lsb == series.lsb for one in pieces)
    assert all(abs(one.hello.rate_hz / whole.hello.rate_hz - 1) < 1e-3 for one in pieces)


def test_a_recording_of_the_daemon(tmp_path: Path) -> None:
    """A frame that a cut divides is lost, and counts as lost on the wire.

    Each piece states at its beginning which device its samples come from.
    """
    whole, pieces = cut_up(ours, tmp_path)
    assert sum(one.counts.before_hello for one in pieces) <= 1
    assert {one.hello.device_id for one in pieces} == {whole.hello.device_id}
    y = np.concatenate([one.axes["gyro_x"].y for one in pieces])
    assert len(whole.axes["gyro_x"].y) - len(pieces) - 1 < len(y) <= len(whole.axes["gyro_x"].y)
    place = 0  # the samples of the pieces are in the same order as in the whole file
    for value in y:
        while whole.axes["gyro_x"].y[place] != value:
            place += 1
        place += 1


@given(
    st.lists(st.text("0123456789.", min_size=1, max_size=30), min_size=3, max_size=80), st.integers(20, 400)
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_lines_of_text_stay_whole(tmp_path: Path, lines: list[str], block_bytes: int) -> None:
    path = tmp_path / "a.csv"
    text = "gyro_x\n" + "\n".join(["1.5", *lines]) + "\n"
    path.write_text(text)
    (file,) = files_of([str(path)])
    cuts = cuts_of(file, msgspec.structs.replace(ASK, how=HOW, block_bytes=block_bytes))
    assert b"".join(text.encode()[cut.begin : cut.end] for cut in cuts) == text.encode()[7:] * bool(cuts)
    assert all(text.encode()[cut.end - 1 : cut.end] == b"\n" for cut in cuts)
    assert {cut.head for cut in cuts} <= {b"gyro_x\n"}


@given(st.lists(st.integers(1, 50), min_size=1, max_size=40), st.integers(1, 200))
@settings(max_examples=40, deadline=None)
def test_pieces_are_even(lengths: list[int], block: int) -> None:
    """The pieces contain all samples, in order.

    `block`: the intended length of a piece. `lengths`: lengths of the parts that must not be divided. No
    piece is longer than `block` plus the longest part.
    """
    places = [0, *np.cumsum(lengths).tolist()]
    pieces = even_pieces(places[:-1], places[-1], block)
    assert [begin for begin, _ in pieces] == [0, *(end for _, end in pieces[:-1])]
    assert pieces[-1][1] == places[-1]
    assert all(end - begin <= block + max(lengths) for begin, end in pieces)


def test_what_cannot_be_cut_is_read_whole(tmp_path: Path) -> None:
    """Some files cannot be cut, and are read whole. Damaged files are also read whole, so that the damage is
    reported.
    """
    small = msgspec.structs.replace(ASK, how=HOW, block_bytes=100)
    torn = ours(tmp_path).read_bytes()[:-40]
    by_columns = io.BytesIO()
    np.save(by_columns, np.asfortranarray(GYRO))
    damaged = bytearray(npy(tmp_path).read_bytes())
    damaged[20] = 255
    for name, data in {
        "torn.mcap": torn,
        "columns.npy": by_columns.getvalue(),
        "damaged.npy": bytes(damaged),
        "short.npy": npy(tmp_path).read_bytes()[:-8],
        "text.csv": b"\x00\x01" * 500,
        "a.db3": b"SQLite format 3\0" * 100,
        "a.npz": b"PK" * 100,
        "a.bag": b"#ROSBAG V2.0\n" * 100,
        "a.mcap": b"\x89MCAP0\r\n" * 100,
        "a.parquet": b"PAR1" * 100,
    }.items():
        (tmp_path / name).write_bytes(data)
        (file,) = files_of([str(tmp_path / name)])
        assert cuts_of(file, small) == [], name


@cache
def bytes_of(make: Callable[[Path], Path]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return make(Path(folder)).read_bytes()


@given(st.data())
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damage_never_ends_the_program(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Whichever bytes are wrong, the program goes on: the file is not cut, or each of its pieces is either
    read or refused.
    """
    folder = tmp_path_factory.mktemp("damage")
    make = data.draw(st.sampled_from([ours, ros1]))
    whole = bytearray(bytes_of(make))
    for _ in range(data.draw(st.integers(1, 4))):
        near_end = data.draw(st.booleans())
        whole[-data.draw(st.integers(1, 400)) if near_end else data.draw(st.integers(0, 400))] = data.draw(
            st.integers(0, 255)
        )
    path = folder / ("x.mcap" if make is ours else "x.bag")
    path.write_bytes(whole)
    (file,) = files_of([str(path)])
    ask = ask_of(make)
    for number, cut in enumerate(cuts_of(file, ask)[:1]):
        (folder / f"p{number}").mkdir()
        with contextlib.suppress(UsageError):
            load(ask.request(write_piece(file, cut, folder / f"p{number}")))
