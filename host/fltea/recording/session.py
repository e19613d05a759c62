"""What each MCAP file of a recording says of itself, and what its channels for the wire hold."""

from typing import Annotated, Literal, NamedTuple

import msgspec

from fltea.records.records import Hello

SESSION, HELLO = "fltea.session", "fltea.hello"
"""Names of the metadata: one SESSION at the head of each file, a HELLO whenever a new one was heard."""

FORMAT = 1
WIRE, LINK = "wire", "link"
"""Last parts of the topics of raw bytes and of what happened to the line; records have their class there."""

WIRE_CHANNEL, LINK_CHANNEL = 1, 2
"""Their ids in each file, so that they can be read without the chunk that says so."""

OVERFLOW = "overflow"
"""Kind of a gap that the recorder itself made, being too slow: it did not see what it missed."""

LATEST_NS = (1 << 62) - 1
"""In the year 2116; sums and differences of such times fit into 64 bits."""

Whole = Annotated[int, msgspec.Meta(ge=-LATEST_NS, le=LATEST_NS)]
"""A number out of a file, where Python itself would take one of a million digits."""

LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 1e-6, 1e7
LOWEST_SCALE, HIGHEST_SCALE = 1e-6, 1e12
"""Far beyond any sensor; what is computed from them stays finite."""

WIRE_WRAP = 1 << 32
"""Numbers of wire messages wrap, as MCAP's field for them does: at 100 a second after 16 months."""


class PartInfo(msgspec.Struct, frozen=True):
    """One file of a session, which is one run of a recorder.

    part: its place in the session, from 0. offset_ns: what was added to the monotonic clock to get the log
    time of wire and link messages, the same in the whole session. created_ns: Unix time. hello: what the
    device had said of itself as of the first message, if it was known then.
    """

    session: str
    part: int
    device: str
    fltea: str
    offset_ns: int
    created_ns: int
    hello: Hello | None = None

    def to_metadata(self) -> dict[str, str]:
        """As MCAP metadata, which is text to text."""
        fields = {name: str(value) for name, value in msgspec.structs.asdict(self).items() if name != "hello"}
        hello = {} if self.hello is None else {"hello": msgspec.json.encode(self.hello).decode()}
        return {"format": str(FORMAT), **fields, **hello}


def from_metadata(metadata: dict[str, str]) -> PartInfo:
    """Undo `to_metadata`.

    Raises:
        ValueError: something is missing or has a wrong type, or the format is of a later version.
    """
    if metadata.get("format") != str(FORMAT):
        raise ValueError(f"format {metadata.get('format')}; this program knows format {FORMAT}")
    hello = None
    if "hello" in metadata:
        try:
            hello = msgspec.json.decode(metadata["hello"], type=Hello)
        except RecursionError as error:  # brackets in brackets in brackets
            raise ValueError("its hello is damaged") from error
        check_hello(hello)
    info = msgspec.convert({**metadata, "hello": hello}, PartInfo, strict=False)
    if max(abs(info.offset_ns), abs(info.created_ns)) > LATEST_NS:
        raise ValueError("its times are not in the years up to 2116: the clock of its recorder was wrong")
    return info


def check_hello(hello: Hello) -> None:
    """Refuse what no device says of itself.

    Raises:
        ValueError: rate or scale are not those of a sensor.
    """
    if not LOWEST_RATE_HZ <= hello.rate_hz <= HIGHEST_RATE_HZ:
        raise ValueError(f"the rate has to be positive and that of a sensor, not {hello.rate_hz:g} Hz")
    for lsb in (hello.gyro_lsb_per_dps, hello.accel_lsb_per_g or None):  # 0: there is no accelerometer
        if lsb is not None and not LOWEST_SCALE <= lsb <= HIGHEST_SCALE:
            raise ValueError(f"the scale has to be positive and that of a sensor, not {lsb:g} LSB")


class LinkMessage(msgspec.Struct, frozen=True, omit_defaults=True):
    """What happened to the line, or to the recording of it.

    kind, message: of a failure. A gap says why (`kind`) and what is missing: chunks and bytes from the wire
    as far as they were counted, and items of any kind.
    """

    event: Literal["opened", "failed", "gap"]
    kind: str = ""
    message: str = ""
    chunks: int = 0
    bytes: int = 0
    items: int = 0


class Entry(NamedTuple):
    """One message of a file. topic: without the device."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes
