"""Reads ROS messages into columns of numbers, by the definition of their type.

The bytes are those of ROS 1, or of ROS 2, which encodes its messages as CDR (Common Data Representation).

The offset of a number in a message depends on the lengths of the texts and lists before it. So all messages
whose texts and lists have equal lengths are read together with numpy. A general ROS library would take about
20 µs for each message.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

CODES = {
    **dict.fromkeys(("bool", "uint8", "char", "octet"), "u1"),
    **dict.fromkeys(("int8", "byte"), "i1"),
    **{f"{sign}{8 * size}": f"{sign[0]}{size}" for sign in ("int", "uint") for size in (2, 4, 8)},
    **dict.fromkeys(("float32", "float"), "f4"),
    **dict.fromkeys(("float64", "double"), "f8"),
}
TIMES = {
    "time": {"secs": "u4", "nsecs": "u4"},
    "duration": {"secs": "i4", "nsecs": "i4"},
    "builtin_interfaces/Time": {"sec": "i4", "nanosec": "u4"},
    "builtin_interfaces/Duration": {"sec": "i4", "nanosec": "u4"},
}
"""Types of ROS 1 and ROS 2 that consist of two numbers, whether or not the bag holds their definitions."""

LIST = -1
"""Value of `Field.many` for a list or text. The 4 bytes before a list or text store its length."""

DEEPEST, MOST_LINES, MOST_LAYOUTS = 10, 5000, 64
LONGEST_PADDING = 7
CDR_HEAD = 4
"""Length of the header before each ROS 2 message, which states the encoding [bytes]."""

PLAIN_CDR = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4)}
"""Byte order, and largest alignment of a number [bytes], for each value of the second byte in the header of a
ROS 2 message. The encodings are CDR of the versions 1 and 2 (XCDR).
"""

_LINE = re.compile(
    r"\s*(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<many>\[(?P<atmost><=)?(?P<count>\d*)\])?\s+(?P<name>[\w.]++)"
    r"(?!\s*=)[^#]*(?:#(?P<said>.*))?"
)
_SEPARATOR = re.compile(r"^=+[ \t]*\r?$", re.M)


class Field(NamedTuple):
    """A field of a message: one number (`many` is None), an array of `many` numbers, or a list (`LIST`).

    `code`: type of a number in numpy's notation. `said`: comments in the definition on the field and on the
    fields that contain it, the innermost field first.
    """

    name: str
    code: str
    many: int | None
    said: tuple[str, ...] = ()


class Definition(NamedTuple):
    """Fields of a message type in the order in which they are stored.

    `is_whole`: whether `fields` are all fields of the message; if not, further fields follow that are not
    read. `said`: comment at the beginning of the definition. `padding`: largest number of padding bytes after
    the last field in CDR, the encoding of ROS 2.
    """

    fields: tuple[Field, ...]
    is_whole: bool = True
    said: str = ""
    padding: int = LONGEST_PADDING


@lru_cache(maxsize=64)
def parse_definition(text: str) -> Definition:
    """Read the definition of a type in the format of `.msg` files, followed by the definitions it refers to.

    Fields after a list of messages or texts are left out, since the offsets of these fields vary.

    Raises:
        ValueError: the text is not a definition.
    """
    first, *others = _SEPARATOR.split(text)
    parts = {}
    for other in others:
        head, _, body = other.strip().partition("\n")
        parts[head.removeprefix("MSG:").strip().replace("/msg/", "/")] = body
    fields: list[Field] = []
    is_whole = True
    for field in _flat(first, "", (), parts, iter(range(MOST_LINES)), DEEPEST):
        if field is None:
            is_whole = False
            break
        fields.append(field)
    if not fields:
        raise ValueError("a definition without fields")
    head = re.match(r"(?:[ \t]*(?:#[^\n]*)?\n)*", first)
    return Definition(tuple(fields), is_whole, "" if head is None else head[0])


def _flat(
    text: str, before: str, said: tuple[str, ...], parts: dict[str, str], lines: Iterator[int], depth: int
) -> Iterator[Field | None]:
    """Yield the fields of a type and of its nested types.

    At the first field of unknown offset, yield None and end.

    `lines`: number of lines that may still be read.
    """
    above: list[str] = []
    for line in text.splitlines():
        if next(lines, None) is None:
            raise ValueError("a definition of too many lines")
        if line.strip().startswith("#"):
            above.append(line)
            continue
        found = _LINE.fullmatch(line)
        if found is None:
            above.clear()
            continue
        name, kind = before + found["name"], found["type"].replace("/msg/", "/")
        about = (found["said"] or "\n".join(above), *said)
        above.clear()
        count = None if found["many"] is None else int(found["count"] or LIST)
        count = LIST if found["atmost"] else count
        if kind in CODES:
            yield Field(name, CODES[kind], count, about)
        elif kind == "string" and count is None:
            yield Field(name, "u1", LIST, about)
        elif kind in TIMES and count is None:
            yield from (Field(f"{name}.{end}", code, None, about) for end, code in TIMES[kind].items())
        else:
            body = _body_of(kind, parts)
            if body is None or count == LIST or not depth:
                yield None
                return
            for i in range(1 if count is None else count):
                if count is not None and next(lines, None) is None:
                    raise ValueError("a definition of too many parts")
                place = f"{name}." if count is None else f"{name}[{i}]."
                yield from _flat(body, place, about, parts, lines, depth - 1)


def _body_of(kind: str, parts: dict[str, str]) -> str | None:
    kind = "std_msgs/Header" if kind == "Header" else kind
    alike = [name for name in parts if name == kind or ("/" not in kind and name.endswith(f"/{kind}"))]
    return parts[alike[0]] if alike else None


Columns = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Indices of messages, and the wanted values of each as numbers. A text is given as the number that `Words`
gave it.
"""


class Words:
    """Gives each different text of a field a number. The numbers are counted separately for each field."""

    def __init__(self) -> None:
        self._of: dict[str, dict[str, int]] = {}

    def of(self, name: str) -> list[str]:
        """Return the different texts of the field `name`. The index of a text is its number in `numbers`."""
        return list(self._of.get(name, ()))

    def numbers(self, name: str, data: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the number given to each text in the field `name`. `data`: bytes of the texts (n, length).

        Equal texts have equal numbers.
        """
        known, size = self._of.setdefault(name, {}), data.shape[1]
        if not size:
            return np.full(len(data), float(known.setdefault("", len(known))))
        words, places = np.unique(np.ascontiguousarray(data).view(f"S{size}")[:, 0], return_inverse=True)
        found = [known.setdefault(one.decode(errors="replace"), len(known)) for one in words.tolist()]
        return np.array(found, np.float64)[places]


def read_columns(
    messages: Sequence[bytes],
    definition: Definition,
    wanted: Sequence[str],
    is_ros1: bool,
    words: Words | None = None,
    check: Callable[[], None] = lambda: None,
) -> Columns:
    """Read the fields `wanted` of messages in the bag's order.

    Messages that do not fit the definition are left out.

    `words`: collects the texts in the wanted fields. `check`: function that is called often, and that may
    raise an error to stop the reading.
    """
    words = Words() if words is None else words
    length = np.fromiter(map(len, messages), np.int64, len(messages))
    rows, numbers = [np.empty(0, np.int64)], [np.empty((0, len(wanted)))]
    for size in np.unique(length).tolist():
        alike = np.flatnonzero(length == size)
        data = np.frombuffer(b"".join([messages[i] for i in alike.tolist()]), np.uint8)
        data = data.reshape(len(alike), size)
        for kind, (order, widest) in {None: ("<", 1)}.items() if is_ros1 else PLAIN_CDR.items():
            written_so = np.arange(len(alike))
            if kind is not None and size >= CDR_HEAD:
                written_so = np.flatnonzero((data[:, 0] == 0) & (data[:, 1] == kind))
            if not len(written_so) or (kind is not None and size < CDR_HEAD):
                continue
            body = data[written_so] if kind is None else data[written_so, CDR_HEAD:]
            for row, values in _read(body, definition, wanted, order, widest, words, check):
                rows.append(alike[written_so[row]])
                numbers.append(values)
    row = np.concatenate(rows)
    in_order = np.argsort(row, kind="stable")
    return row[in_order], np.concatenate(numbers)[in_order]


def _read(
    data: NDArray[np.uint8],
    definition: Definition,
    wanted: Sequence[str],
    order: str,
    widest: int,
    words: Words,
    check: Callable[[], None],
) -> Iterator[Columns]:
    """Read the fields `wanted` of messages that all have the same length. Yield those of one layout at once.

    `data`: bytes of the messages (n, length), without the header of ROS 2's encoding.
    """
    size = data.shape[1]
    in_field: dict[str, list[tuple[str, int]]] = {}
    for name in wanted:
        base, _, place = name.removesuffix("]").partition("[")
        in_field.setdefault(base if place.isdecimal() else name, []).append((name, int(place or 0)))
    layouts: list[tuple[NDArray[np.int64], int, dict[str, tuple[int, str]]]]
    layouts = [(np.arange(len(data)), 0, {})]
    for field in definition.fields:
        check()
        width = int(field.code[1])
        after = []
        for rows, at, places in layouts[:MOST_LAYOUTS]:
            if field.many == LIST:
                at = _aligned(at, min(4, widest))
                if at + 4 > size:
                    continue
                counts = _numbers(data[rows], at, f"{order}u4").astype(np.int64)
                for count in np.unique(counts[counts * width <= size - at - 4]).tolist():
                    begin = _aligned(at + 4, min(width, widest)) if count else at + 4
                    text = {field.name: (begin, f"S{count}")} if field.name in wanted else {}
                    after.append((rows[counts == count], begin + count * width, {**places, **text}))
            else:
                begin = _aligned(at, min(width, widest))
                many = 1 if field.many is None else field.many
                its = [(name, i) for name, i in in_field.get(field.name, ()) if i < many]
                found = {name: (begin + i * width, order + field.code) for name, i in its}
                end = begin + many * width
                after.append((rows, end, {**places, **found} if found else places))
        layouts = [layout for layout in after if layout[1] <= size]
    for rows, at, places in layouts:
        left = size - at
        if not {*wanted} <= places.keys():
            continue
        if not definition.is_whole or 0 <= left <= (definition.padding if widest > 1 else 0):
            columns = [_column(data[rows], name, *places[name], words) for name in wanted]
            yield rows, np.column_stack(columns)


def _column(data: NDArray[np.uint8], name: str, at: int, kind: str, words: Words) -> NDArray[np.float64]:
    """Return the value of the field `name` in each message. A text is replaced by its number in `words`."""
    return (
        words.numbers(name, data[:, at : at + int(kind[1:])]) if kind[0] == "S" else _numbers(data, at, kind)
    )


def _aligned(at: int, to: int) -> int:
    return -(-at // to) * to


def _numbers(data: NDArray[np.uint8], at: int, kind: str) -> NDArray[np.float64]:
    """Return the number of type `kind` that is stored at offset `at` of each message."""
    width = np.dtype(kind).itemsize
    found: NDArray[np.float64] = np.ascontiguousarray(data[:, at : at + width]).view(kind)[:, 0]
    return found.astype(np.float64)
