"""Reads bags of ROS 2: SQLite or MCAP files, and the folders that `ros2 bag record` makes of them.

The file `metadata.yaml` of a folder is not used: the bag's files hold the same facts, and a recorder that was
killed has not written `metadata.yaml`.
"""

import contextlib
import itertools
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from fltea.recording.bag_files import PACKED
from fltea.recording.bag_messages import DEFINITIONS, LONGEST_MESSAGE, Batch, Topic, encoding_of, undescribed
from fltea.recording.files import Note
from fltea.recording.quota import Quota
from fltea.recording.session import LATEST_NS
from fltea.records.events import Ints
from fltea.records.small_file import open_file
from fltea.records.temporary import named_file, work_folder
from fltea.settings.extras import load
from fltea.settings.limits import Limits

AT_ONCE = 4096
"""Largest number of messages in a batch."""

PIECE_BYTES = 1 << 10
"""Number of compressed bytes that are decompressed at once: at most some 32 MB come out."""

STEPS = 10_000
"""The time limit is checked again after this number of steps of SQLite's virtual machine."""

SQLITE_LIMITS = {
    sqlite3.SQLITE_LIMIT_SQL_LENGTH: 1 << 20,
    sqlite3.SQLITE_LIMIT_COLUMN: 100,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 20,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 3,
    sqlite3.SQLITE_LIMIT_ATTACHED: 0,
    sqlite3.SQLITE_LIMIT_LIKE_PATTERN_LENGTH: 100,
}

NO_TIME = LATEST_NS + 1
"""Value in place of an arrival time that is missing or not a number."""


def read_sqlite(path: Path, limits: Limits) -> Iterator[Batch | Note]:
    """Yield the Imu messages of a .db3 file, the names of all topics, and notes on what is unreadable.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a bag of ROS 2.
        UsageError: reading takes more time than is allowed for a file of its size.
    """
    quota = Quota(path, limits)
    try:
        with (
            _whole_pages(path) as (file, is_cut),
            contextlib.closing(_open_sqlite(file, limits)) as connection,
        ):
            connection.set_progress_handler(quota.is_over, STEPS)
            _check_tables(connection)
            definitions = _definitions(connection)
            topics = {}
            for number, *texts in connection.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ):
                if isinstance(number, int) and all(isinstance(text, str) for text in texts):
                    schema = definitions.get(texts[1], b"")
                    topics[number] = Topic(texts[0], texts[1], encoding_of(texts[2]), schema)
            yield from map(Batch, topics.values())
            yield from _rows(path, connection, topics, is_cut, quota)
    except sqlite3.Error as error:
        if quota.is_over():
            raise quota.too_slow() from error
        raise ValueError(f"no bag of ROS 2 in SQLite, or damaged where it begins: {error}") from error


def _check_tables(connection: sqlite3.Connection) -> None:
    """Raise ValueError unless the bag's tables are plain tables.

    They must not be views or have computed columns. SQLite's own parser is asked for the kind of a table,
    since the schema in the file may name a wrong kind.
    """
    kinds = {name: kind for _, name, kind, *_ in connection.execute("PRAGMA main.table_list")}
    for name in ("topics", "messages"):
        if kinds.get(name) != "table":
            raise ValueError(f"no bag of ROS 2 in SQLite: it has no table {name}")
        if any(hidden for *_, hidden in connection.execute(f"PRAGMA main.table_xinfo({name})")):
            raise ValueError(f"no bag of ROS 2 in SQLite: columns of its table {name} are computed")


def _definitions(connection: sqlite3.Connection) -> dict[str, bytes]:
    """Return the definitions of message types in the form of `.msg` files. Only newer bags hold them."""
    kinds = {name: kind for _, name, kind, *_ in connection.execute("PRAGMA main.table_list")}
    columns = list(connection.execute("PRAGMA main.table_xinfo(message_definitions)"))
    if kinds.get("message_definitions") != "table" or any(hidden for *_, hidden in columns):
        return {}
    if not {"topic_type", "encoding", "encoded_message_definition"} <= {name for _, name, *_ in columns}:
        return {}
    rows = connection.execute(
        "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
    )
    return {kind: text.encode() for kind, text in rows if isinstance(kind, str) and isinstance(text, str)}


def _open_sqlite(path: Path, limits: Limits) -> sqlite3.Connection:
    """Open a file for reading only, together with the write-ahead log of a killed recorder if there is one.

    SQLite's defensive mode is not used, since it refuses the schema of a truncated file.
    """
    uri = path.resolve().as_uri()
    with_log = ["mode=ro"] if path.with_name(path.name + "-wal").exists() else []
    for mode in (*with_log, "immutable=1"):
        connection = sqlite3.connect(f"{uri}?{mode}", uri=True)
        try:
            connection.text_factory = lambda text: text.decode(errors="replace")
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, limits.chunk_bytes)
            for kind, most in SQLITE_LIMITS.items():
                connection.setlimit(kind, most)
            for setting in ("trusted_schema=OFF", "query_only=ON", "cell_size_check=ON", "mmap_size=0"):
                connection.execute(f"PRAGMA {setting}")
            # without this setting SQLite refuses a truncated file
            connection.execute("PRAGMA writable_schema=ON")
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.OperationalError:
            connection.close()
            if mode == "immutable=1":
                raise
        except BaseException:
            connection.close()
            raise
        else:
            return connection
    raise AssertionError


@contextlib.contextmanager
def _whole_pages(path: Path) -> Iterator[tuple[Path, bool]]:
    """Yield an SQLite file without its incomplete last page, and whether the file is truncated.

    SQLite would read an incomplete page as if its missing bytes were zeros, and report nothing.
    """
    with path.open("rb") as file:
        head = file.read(32)
        size = file.seek(0, 2)
    page_bytes, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    page_bytes = 1 << 16 if page_bytes == 1 else page_bytes
    is_cut = size < pages * page_bytes
    if not is_cut or size % page_bytes == 0:
        yield path, is_cut
        return
    with work_folder() as folder:
        copy = folder / path.name
        with path.open("rb") as file, named_file(copy) as out:
            shutil.copyfileobj(file, out)
            out.truncate(size - size % page_bytes)
        yield copy, True


def _rows(
    path: Path, connection: sqlite3.Connection, topics: dict[int, Topic], is_cut: bool, quota: Quota
) -> Iterator[Batch | Note]:
    wanted = [number for number, topic in topics.items() if topic.is_imu]
    rows = connection.execute(
        f"SELECT topic_id, timestamp, CASE WHEN length(data) <= {LONGEST_MESSAGE} THEN data END "
        f"FROM messages WHERE topic_id IN ({','.join('?' * len(wanted))}) ORDER BY id",
        wanted,
    )
    problem: sqlite3.Error | None = None
    while problem is None:
        taken: list[tuple[int, Any, Any]] = []
        try:
            taken.extend(itertools.islice(rows, AT_ONCE))
        except sqlite3.Error as error:
            if quota.is_over():
                raise
            problem = error
        if not taken:
            break
        batches: dict[int, Batch] = {}
        for number, arrival_ns, data in taken:
            batch = batches.setdefault(number, Batch(topics[number]))
            batch.count += 1
            batch.arrival_ns.append(arrival_ns if isinstance(arrival_ns, int) else NO_TIME)
            batch.data.append(data if isinstance(data, bytes) else b"")
        yield from batches.values()
    if problem is not None or is_cut:
        why = "" if problem is None else f" ({problem})"
        yield Note("cut_recording", f"{path}: is cut off or damaged{why}; what can be read of it is used.")


def read_mcap(path: Path, limits: Limits) -> Iterator[Batch | Note]:
    """Yield the messages of an MCAP file, and notes on what is unreadable.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not an MCAP file.
        UsageError: a record needs more memory than the limits allow, or the library is not installed.
    """
    module = load("fltea.recording.scan", "mcap", "ros", "MCAP files need")
    schemas: dict[int, tuple[str, bytes]] = {}
    topics: dict[int, Topic] = {}
    publishers: dict[int, str] = {}
    scan, unknown = module.Scan(path, limits), 0
    for item in scan:
        match item:
            case module.Schema():
                schemas[item.id] = item.name, item.data if item.encoding in DEFINITIONS else b""
            case module.Channel():
                encoding = encoding_of(item.message_encoding)
                name, schema = schemas.get(item.schema_id, ("", b""))
                topics[item.id] = Topic(item.topic, name, encoding, schema)
                publishers[item.id] = item.metadata.get("callerid") or f"channel {item.id}"
                yield Batch(topics[item.id])
            case module.Messages():
                channels = item.table[:, module.CHANNEL]
                for number in np.unique(channels).tolist():
                    if number in topics:
                        rows = item.table[channels == number]
                        yield _batch_of(topics[number], publishers[number], item.data, rows, module)
                    else:
                        unknown += int((channels == number).sum())
            case module.Damage(size=0):
                yield Note("cut_recording", f"{path} {item.said}.")
            case module.Damage():
                text = f"{path}: the record at byte {item.offset} is damaged ({item.text}) and left out."
                yield Note("recording_gap", text)
    if not scan.whole:
        text = (
            f"{path}: ends without its index, so it was not closed, or is cut off; what can be read is used."
        )
        yield Note("cut_recording", text)
    if unknown:
        yield undescribed(path, unknown)


def _batch_of(topic: Topic, publisher: str, data: bytes, table: Ints, module: ModuleType) -> Batch:
    if not topic.is_imu:
        return Batch(topic, len(table))
    spans = zip(table[:, module.BEGIN].tolist(), table[:, module.END].tolist(), strict=True)
    arrival_ns = table[:, module.LOG_TIME].tolist()
    return Batch(topic, len(table), arrival_ns, [data[begin:end] for begin, end in spans], publisher)


class Unpacked(NamedTuple):
    """A bag file to read. `is_cut`: whether it is a copy of compressed data that end too early."""

    path: Path
    is_cut: bool = False


@contextlib.contextmanager
def unpacked_file(path: Path, limits: Limits) -> Iterator[Unpacked]:
    """Yield a bag file. A compressed one is decompressed to a temporary copy.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is damaged, or is cut off before anything of it can be decompressed.
        UsageError: the decompressed content is larger than the limits allow, or zstandard is not installed.
    """
    if path.suffix != PACKED:
        yield Unpacked(path)
        return
    zstandard = load("zstandard", "zstandard", "ros", "Bags that are compressed by zstd need")
    with work_folder() as folder:
        out = folder / path.stem
        try:
            with open_file(path) as packed, named_file(out) as file:
                quota, unpacker = Quota(path, limits), zstandard.ZstdDecompressor().decompressobj()
                while not unpacker.eof and (piece := packed.read(PIECE_BYTES)):
                    quota.unpack(file.write(unpacker.decompress(piece)))
                size = file.tell()
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
        if not unpacker.eof and not size:
            raise ValueError("it is cut off before anything of it can be decompressed; copy it again")
        yield Unpacked(out, not unpacker.eof)
