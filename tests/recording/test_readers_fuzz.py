"""Readers of recordings get files of random bytes, and real files with changes anywhere. The result is
records, or an error with a reason.

A crash, a hang or huge memory is a fault.
"""

import contextlib
import gzip
import io
import json
import tracemalloc
import zipfile
import zlib
from pathlib import Path
from typing import Any

import h5py
import msgspec
import numpy as np
import pyarrow as pa
import pytest
from fltea.archive.export import export
from fltea.archive.info import as_text, summarise
from fltea.identification.load import Loaded, Request, load
from fltea.recording.formats import FORMATS
from fltea.recording.npz_file import NPZ_ARRAYS
from fltea.recording.recovery import recover
from fltea.recording.session import SESSION
from fltea.records.errors import FlteaError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import Limits
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Message, Metadata
from pyarrow import feather, parquet

from tests.rig import hostile_files
from tests.rig.bag_support import even, write_bag
from tests.rig.corpus_files import HERE
from tests.rig.hostile_files import Files
from tests.rig.mcap_support import record, transport
from tests.rig.tiers import long_but, slow, slow_but

LIMITS = Limits(max_chunk_mb=1, max_mb=1)
MOST_BYTES = 40_000_000
"""Largest memory that reading may take [bytes]. It allows for twice the limits for data, and for what a
recording within these limits needs besides its data.
"""

Change = tuple[float, bytes, int]
places = st.floats(0, 1, exclude_max=True)
LENGTHS = [byte * count for byte in (b"\x00", b"\xff") for count in (1, 2, 4, 8)]
"""Encoded lengths: the smallest and the largest length that a format can state in a field of 1, 2, 4 or 8
bytes.
"""
holes = st.tuples(places, st.integers(13, 3000)).map(lambda hole: (hole[0], bytes(hole[1]), hole[1]))
"""Holes of zeros, as in a file that was truncated while it was written, or in a sparse file."""

changes = st.lists(
    st.one_of(
        st.tuples(places, st.binary(max_size=12), st.integers(0, 12)),
        st.builds(lambda at, length: (at, length, len(length)), places, st.sampled_from(LENGTHS)),
        holes,
    ),
    min_size=1,
    max_size=4,
)
"""Changes of a file: for each, an offset, the bytes written there, and how many bytes they replace."""

WHOLE = [0, -1, 1, 2**31, 2**32, 2**63 - 1, 2**63, 2**64 - 1, 10**30]
NUMBERS = [*WHOLE, 1e-320, 1e-9, 1e308, 1e999, True, None]
ODD = [*NUMBERS, "", "x", "1", [], [0.0] * 4, ["x"], {}, {"a": 1}, "\x1b[31m"]
odd = st.sampled_from(ODD)


def changed(data: bytes, how: list[Change]) -> bytes:
    for place, put, gone in how:
        at = int(place * len(data))
        data = data[:at] + put + data[at + gone :]
    return data


def walk(path: Path) -> None:
    """Run all code that reads recordings on a file, to its end.

    A file that a library reads is read only once. The code after the library is the same for every format,
    and each reading starts a reader process, which takes most of a second.
    """
    how = How(rate_hz=100.0, units="dps") if path.suffix == ".npy" else AS_IT_SAYS
    out = path.with_name("out.npz")
    stages = [
        lambda: check_finite(load(Request((path,), None, how, LIMITS))),
        lambda: as_text(summarise([path], 100, LIMITS, how)),
        lambda: export([path], out, "samples", 100, force=True, limits=LIMITS, how=how),
        lambda: export([path], out.with_suffix(".csv"), "estimates", 100, force=True, limits=LIMITS),
    ]
    for what in stages[:1] if path.name in BY_LIBRARY else stages:
        with contextlib.suppress(FlteaError):
            what()
    if path.suffix == ".mcap":
        with contextlib.suppress(FlteaError):
            recover(path, in_place=True, limits=LIMITS)


def check_finite(found: Loaded) -> None:
    assert all(np.isfinite(one.y).all() for one in found.axes.values())


def check(folder: Path, name: str, data: bytes) -> None:
    """Read a file with all code that reads recordings. For about a third of the files, chosen by checksum,
    also measure the memory that this takes.

    Measuring the memory takes two thirds of the test's time. The files that need most memory are tested in
    test_hostile_files.py.
    """
    path = folder / name
    path.write_bytes(data)
    if zlib.crc32(data) % 3:
        walk(path)
        return
    tracemalloc.start()
    try:
        walk(path)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Return one file of every format that fltea writes."""
    folder = tmp_path_factory.mktemp("real")
    lines, _ = record(folder, transport(samples=60, boots=2))
    (mcap,) = folder.glob("*.mcap")
    found = Files({"due.mcap": mcap.read_bytes()})
    for name in ("rest.npz", "rest.csv"):
        export([mcap], folder / name, "samples", 100)
        found[name] = (folder / name).read_bytes()
    found["run.ndjson"] = b"\n".join(msgspec.json.encode(line) for line in lines) + b"\n"
    gyro = np.random.default_rng(1).normal(size=(120, 1))
    np.save(folder / "rest.npy", gyro)
    table = pa.table({"time_s": np.arange(120) / 100, "gyro_x_dps": gyro[:, 0]})
    parquet.write_table(table, folder / "rest.parquet")
    feather.write_feather(table, folder / "rest.feather")
    with h5py.File(folder / "rest.h5", "w") as file:
        for name in table.column_names:
            file[name] = table[name].to_numpy()
    (folder / "rest.tsv").write_bytes(found["rest.csv"].replace(b",", b"\t"))
    (folder / "rest.csv.gz").write_bytes(gzip.compress(found["rest.csv"], mtime=0))
    messages = even(120)
    write_bag(folder / "ros1.bag", {"/imu": messages})
    (database,) = write_bag(folder / "ros2.db3", {"/imu": messages}).glob("*.db3")
    found["ros2.db3"] = database.read_bytes()
    return Files({name: (folder / name).read_bytes() for name in KINDS if name not in found} | found)


KINDS = [
    *(
        "due.mcap",
        "rest.npz",
        "rest.csv",
        "run.ndjson",
        "rest.npy",
        "rest.parquet",
        "rest.feather",
        "rest.h5",
    ),
    *("rest.tsv", "rest.csv.gz", "ros1.bag", "ros2.db3"),
]


KINDS_OF_FLTEA = KINDS[:5]
"""Files that fltea reads without a reader process."""

BY_LIBRARY = ("rest.parquet", "rest.feather", "rest.h5")
"""Files that a library reads in a reader process."""


@pytest.mark.parametrize("name", slow_but(KINDS_OF_FLTEA, KINDS))
def test_the_real_files_are_read(name: str, real: Files, folder: Path) -> None:
    (folder / name).write_bytes(real[name])
    how = How(rate_hz=100.0, units="dps") if name == "rest.npy" else AS_IT_SAYS
    assert summarise([folder / name], 100, LIMITS, how).counts.delivered > 100


@pytest.mark.parametrize(
    "name", long_but(["rest.npz", "rest.csv", "ros2.db3", "rest.h5"], KINDS, quick=["rest.npy"])
)
def test_files_that_were_changed_anywhere(name: str, real: Files, folder: Path) -> None:
    """Readers withstand changes anywhere in a file.

    If a library reads the file, this only tests how errors of the library are handled, so few examples are
    enough.
    """

    @given(how=changes)
    @settings(max_examples=12 if name in BY_LIBRARY else 50)
    def holds(how: list[Change]) -> None:
        check(folder, name, changed(real[name], how))

    holds()


@pytest.mark.long
@given(how=changes)
@settings(max_examples=12)
@pytest.mark.parametrize("name", [name for form in FORMATS.values() if form.reader for name in form.corpus])
def test_examples_that_were_changed_anywhere(name: str, folder: Path, how: list[Change]) -> None:
    """Readers withstand changes anywhere in the example files of their format. The libraries for some formats
    take a second to start, so each changed file is read once.
    """
    path = folder / name
    path.write_bytes(changed((HERE / name).read_bytes(), how))
    with contextlib.suppress(FlteaError):
        check_finite(load(Request((path,), None, AS_IT_SAYS, LIMITS)))


IN_A_PROCESS = ["rest.parquet", "rest.feather", "rest.h5"]
"""Files that a reader process reads, which takes half a second to start."""
IN_THIS_ONE = [name for name in [*KINDS, "noending"] if name not in IN_A_PROCESS]


@given(data=st.binary(max_size=300))
@settings(max_examples=30)
@pytest.mark.parametrize("name", slow_but(["due.mcap", "rest.csv", "ros2.db3", "noending"], IN_THIS_ONE))
def test_any_bytes(name: str, folder: Path, data: bytes) -> None:
    check(folder, name, data)


@given(data=st.binary(max_size=300))
@settings(max_examples=4)
@pytest.mark.parametrize("name", [*map(slow, IN_A_PROCESS)])
def test_any_bytes_in_a_process(name: str, folder: Path, data: bytes) -> None:
    check(folder, name, data)


@pytest.mark.slow
@given(line=st.integers(0, 400), key=st.integers(0, 40), value=odd)
@settings(max_examples=50)
def test_ndjson_with_odd_values(real: Files, folder: Path, line: int, key: int, value: Any) -> None:
    lines = [json.loads(text) for text in real["run.ndjson"].splitlines()]
    lines = [one for one in lines if one["class"] in ("hello", "epoch", "sample")]
    one = lines[line % 8 if line < 200 else line % len(lines)]
    one[sorted(one)[key % len(one)]] = value
    text = "\n".join(json.dumps(one) for one in lines).replace("Infinity", "1e999")
    check(folder, "run.ndjson", text.encode())


ARRAYS = [name for name in NPZ_ARRAYS if name not in ("gyro_dps", "accel_ms2")]
"""The arrays of an .npz file whose samples are in counts."""


@pytest.mark.slow
@given(
    name=st.sampled_from(ARRAYS),
    value=st.sampled_from([number for number in NUMBERS if isinstance(number, int | float)]),
    row=st.integers(0, 200) | st.none(),
    kind=st.sampled_from(["<f8", "<i8", "<u8", "<f4", "<i2", "<f2", "<f16", "?", "<c16", "<U4", "<M8[s]"]),
)
@settings(max_examples=50)
def test_npz_with_odd_numbers(
    real: Files, folder: Path, name: str, value: Any, row: int | None, kind: str
) -> None:
    """One array of a recording gets an unusual value, in one row or in all rows."""
    with np.load(io.BytesIO(real["rest.npz"])) as archive:
        arrays = {key: archive[key] for key in archive.files}
    with np.errstate(all="ignore"):
        try:
            if row is None:
                arrays[name] = np.full(arrays[name].shape, value).astype(kind)
            else:
                array = np.atleast_1d(arrays[name]).astype(kind)
                array[row % len(array)] = value
                arrays[name] = array
        except (OverflowError, ValueError, TypeError):
            return
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    check(folder, "rest.npz", buffer.getvalue())


@pytest.mark.slow
@given(how=changes, name=st.sampled_from(ARRAYS))
@settings(max_examples=50)
def test_npz_with_changed_arrays(real: Files, folder: Path, how: list[Change], name: str) -> None:
    """One array is changed before the archive is written, so the checksums in the archive are correct."""
    with zipfile.ZipFile(io.BytesIO(real["rest.npz"])) as archive:
        arrays: dict[str, Any] = {key[:-4]: archive.read(key) for key in archive.namelist()}
    arrays[name] = changed(arrays[name][:300], how) + arrays[name][300:]
    check(folder, "rest.npz", hostile_files.npz(folder / "made.npz", **arrays).read_bytes())


def mcap_of(*messages: tuple[str, int, int, int, bytes], **info: str) -> bytes:
    """Return an MCAP file with messages outside of chunks, so that nothing checks them before the reader."""
    builder = RecordBuilder()
    topics = {"wire": 1, "link": 2, "estimate": 3}
    for topic, number in topics.items():
        Channel(number, f"/due/{topic}", "json", {}, 0).write(builder)
    for topic, sequence, log_ns, publish_ns, data in messages:
        Message(
            channel_id=topics[topic], data=data, log_time=log_ns, publish_time=publish_ns, sequence=sequence
        ).write(builder)
    data = hostile_files.mcap_with(bytes(builder.end()))
    if info:
        head = RecordBuilder()
        metadata = {"format": "1", "session": "s", "part": "0", "device": "due", "fltea": "1"}
        metadata |= {"offset_ns": "0", "created_ns": "0"}
        Metadata(metadata={**metadata, **info}, name=SESSION).write(head)
        data = data[:8] + bytes(head.end()) + data[8:]
    return data


time_ns = st.sampled_from([0, 1, 10**9, 10**18, 2**63 - 1, 2**63, 2**64 - 1])
text = st.sampled_from(
    [
        b"{}",
        b"[]",
        b"",
        b"null",
        b"{" * 100,
        b'{"event":"opened"}',
        b'{"event":"failed","kind":"\x1b[31m"}',
        b'{"event":"gap","items":-1,"bytes":1e30}',
        b'{"a":' * 50_000,
        b'{"host_ns":1}',
        b'{"axes":1}',
        b'{"host_ns":1,"axes":{"gyro_x":{"alpha":"x"}},"epoch":[],"seq":{},"device_us":null}',
        b'{"host_ns":"x","epoch":1,"seq":1,"device_us":1,"axes":[]}',
        b'{"host_ns":1e300,"epoch":1,"seq":1e300,"device_us":1,"axes":{}}',
    ]
)


@pytest.mark.slow
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["wire", "link", "estimate"]), st.integers(0, 2**32 - 1), time_ns, time_ns, text
        ),
        max_size=5,
    )
)
@settings(max_examples=50)
def test_mcap_with_odd_messages(folder: Path, messages: list[tuple[str, int, int, int, bytes]]) -> None:
    check(folder, "due.mcap", mcap_of(*messages))


@given(
    key=st.sampled_from(["format", "session", "part", "device", "offset_ns", "created_ns", "hello"]),
    value=st.sampled_from(
        ["", "x", "-1", "1e999", str(2**70), "9" * 5000, "nan", "{" * 100_000, "\x00", "../x"]
    ),
)
@settings(max_examples=40)
def test_mcap_with_an_odd_head(real: Files, folder: Path, key: str, value: str) -> None:
    opened = ("link", 0, 10**18, 10**18, b'{"event":"opened"}')
    check(folder, "due.mcap", mcap_of(opened, opened, **{key: value}))


@pytest.mark.slow
@given(key=st.integers(0, 40), value=odd)
@settings(max_examples=25)
def test_mcap_with_an_odd_hello(real: Files, folder: Path, key: int, value: Any) -> None:
    """A field of the HELLO is changed in the metadata at the beginning of an MCAP file.

    The recorded bytes that follow come from a correct device.
    """
    hello = next(json.loads(line) for line in real["run.ndjson"].splitlines() if b'"hello"' in line)
    hello[sorted(hello)[key % len(hello)]] = value
    chunks = [item.data for item in transport(samples=60) if hasattr(item, "data")]
    messages = [("wire", k, 10**18 + k * 10**7, 10**18 + k * 10**7, data) for k, data in enumerate(chunks)]
    check(folder, "due.mcap", mcap_of(*messages[5:], part="1", hello=json.dumps(hello)))
