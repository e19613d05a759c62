"""Small SQLite files that pass for bags of ROS 2. A query for one of their rows would compute without end."""

import contextlib
import sqlite3
from collections.abc import Callable
from pathlib import Path

TOPICS = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
    "INSERT INTO topics VALUES (1, '/imu', 'sensor_msgs/msg/Imu', 'cdr');"
)
PLAIN = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
ROWS = ENDLESS + "SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(9) AS data FROM n"
ENDLESS_TREE = "a tree without an end"
COSTLY = "length(replace(hex(zeroblob(400000)), '0', hex(zeroblob(40))))"


def _made_by(script: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with contextlib.closing(sqlite3.connect(path)) as connection:
            connection.executescript(TOPICS + script)

    return make


def _disguised(name: str, view: str) -> str:
    """Return SQL statements that create a view and then falsify the schema.

    The falsified schema calls the view a table.
    """
    text = view.replace("'", "''")
    return (
        f"CREATE VIEW {name} AS {view}; PRAGMA writable_schema=ON;"
        f"UPDATE sqlite_master SET type='table', rootpage=0, sql='CREATE VIEW {name} AS {text}' "
        f"WHERE name='{name}';"
    )


def _without_end(path: Path) -> None:
    """Write a table of 100^12 rows in a file of a few kB.

    All entries of an inner page of its B-tree refer to the same page below.
    """
    page_bytes, depth, children = 1024, 12, 100
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.executescript(f"PRAGMA page_size={page_bytes};" + TOPICS + PLAIN)
        connection.execute("INSERT INTO messages VALUES (1, 1, 1, zeroblob(9))")
        connection.commit()
        (leaf,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name='messages'").fetchone()
        connection.executescript(
            "CREATE TABLE filler(x);" + f"INSERT INTO filler VALUES (zeroblob({page_bytes}));" * (depth + 2)
        )
        (pages,) = connection.execute("PRAGMA page_count").fetchone()
    data = bytearray(path.read_bytes())

    def page(number: int) -> slice:
        return slice((number - 1) * page_bytes, number * page_bytes)

    below = pages
    data[page(below)] = data[page(leaf)]
    for number in [*range(pages - 1, pages - depth, -1), leaf]:
        cells = b"".join(below.to_bytes(4, "big") + bytes([k]) for k in range(children))
        first = page_bytes - len(cells)
        places = b"".join((first + 5 * k).to_bytes(2, "big") for k in range(children))
        head = bytes([5, 0, 0]) + children.to_bytes(2, "big") + first.to_bytes(2, "big") + b"\0"
        inner = head + below.to_bytes(4, "big") + places
        data[page(number)] = inner + bytes(first - len(inner)) + cells
        below = number
    path.write_bytes(data)


def _computed_topics(path: Path) -> None:
    view = ENDLESS + "SELECT i AS id, 'a' AS name, 'b' AS type, 'cdr' AS serialization_format FROM n"
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.executescript(PLAIN + _disguised("topics", view))


HOSTILE: dict[str, Callable[[Path], None]] = {
    "a view": _made_by(f"CREATE VIEW messages AS {ROWS};"),
    "a view disguised as a table": _made_by(_disguised("messages", ROWS)),
    "a costly generated column": _made_by(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        f"data BLOB AS ({COSTLY}) VIRTUAL);" + ENDLESS + "INSERT INTO messages(topic_id, timestamp) "
        "SELECT 1, i FROM n LIMIT 300;"
    ),
    "topics that are computed": _computed_topics,
    "a table of a module": _made_by(
        "CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, timestamp, data);"
    ),
    ENDLESS_TREE: _without_end,
}
"""Functions that make hostile SQLite files, by what is hostile in the file."""
