"""Defines the metadata of an MCAP file of a recording, and the messages of its channels for raw bytes."""

from typing import Annotated, Literal, NamedTuple

import msgspec

from fltea.records.records import Hello

SESSION, HELLO = "fltea.session", "fltea.hello"
"""Names of metadata records. A file has one SESSION record at its beginning, and a HELLO record whenever the
device sends a new HELLO message.
"""

FORMAT = 1
WIRE, LINK = "wire", "link"
"""Last parts of the names of two topics. WIRE: the topic of raw bytes. LINK: the topic of port events. The
names of other topics end in the class of their records.
"""

WIRE_CHANNEL, LINK_CHANNEL = 1, 2
"""IDs of the channels of raw bytes and of port events. They are equal in all files, so that messages are
readable even if a channel's description is lost.
"""

OVERFLOW = "overflow"
"""One of the kinds of gaps in a recording: the recorder was too slow and lost items, and did not count them.
"""

LATEST_NS = (1 << 62) - 1
"""Latest accepted time, in the year 2116 [ns]; sums and differences of such times fit into 64 bits."""

Whole = Annotated[int, msgspec.Meta(ge=-LATEST_NS, le=LATEST_NS)]
"""A whole number in a file. Its size is limited, since a damaged file may hold a number with a million
digits, which Python would read.
"""

LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 1e-6, 1e7
LOWEST_SCALE, HIGHEST_SCALE = 1e-6, 1e12
"""Limits for the sampling rate and for the scales in a HELLO message. The limits are far beyond the values of
any sensor. Rates and scales within them cause no overflow in later computations.
"""

WIRE_WRAP = 1 << 32
"""Sequence numbers of messages with raw bytes are counted modulo this number, since MCAP's field for them has
32 bits.
"""


class PartInfo(msgspec.Struct, frozen=True):
    """Metadata of one file of a session; a session is one run of a recorder.

    `part`: index of the file in the session, from 0. `offset_ns`: offset from the monotonic clock to the log
    time of messages of raw bytes and of port events [ns], equal in the whole session. `created_ns`: Unix time
    of creation [ns]. `hello`: the device's HELLO that was known before the first message of the file, or
    None.
    """

    session: str
    part: int
    device: str
    fltea: str
    offset_ns: int
    created_ns: int
    hello: Hello | None = None

    def to_metadata(self) -> dict[str, str]:
        """Return the metadata as a dictionary of texts, the only form in which MCAP can store metadata."""
        fields = {name: str(value) for name, value in msgspec.structs.asdict(self).items() if name != "hello"}
        hello = {} if self.hello is None else {"hello": msgspec.json.encode(self.hello).decode()}
        return {"format": str(FORMAT), **fields, **hello}


def from_metadata(metadata: dict[str, str]) -> PartInfo:
    """Return the `PartInfo` from metadata that `to_metadata` wrote.

    Raises:
        ValueError: a field is missing or has a wrong type, or the format is of a later version.
    """
    if metadata.get("format") != str(FORMAT):
        raise ValueError(f"format {metadata.get('format')}; this program knows format {FORMAT}")
    hello = None
    if "hello" in metadata:
        try:
            hello = msgspec.json.decode(metadata["hello"], type=Hello)
        except RecursionError as error:  # msgspec raises RecursionError if the JSON text is nested too deeply
            raise ValueError("its hello is damaged") from error
        check_hello(hello)
    info = msgspec.convert({**metadata, "hello": hello}, PartInfo, strict=False)
    if max(abs(info.offset_ns), abs(info.created_ns)) > LATEST_NS:
        raise ValueError("its times are not between the years 1970 and 2116: the recorder's clock was wrong")
    return info


def check_hello(hello: Hello) -> None:
    """Raise an error if a HELLO message holds numbers that no sensor can have sent.

    Raises:
        ValueError: no sensor has this rate or scale.
    """
    if not LOWEST_RATE_HZ <= hello.rate_hz <= HIGHEST_RATE_HZ:
        raise ValueError(f"the rate must be positive and possible for a sensor, but is {hello.rate_hz:g} Hz")
    # a scale of 0 means that there is no accelerometer
    for lsb in (hello.gyro_lsb_per_dps, hello.accel_lsb_per_g or None):
        if lsb is not None and not LOWEST_SCALE <= lsb <= HIGHEST_SCALE:
            raise ValueError(f"the scale must be positive and possible for a sensor, but is {lsb:g} LSB")


class LinkMessage(msgspec.Struct, frozen=True, omit_defaults=True):
    """An event of the serial port or of the recorder, as it is stored in a recording.

    `kind`, `message`: kind and description of a failure. For a gap in the recording, `kind` is the reason for
    the gap. `chunks` and `bytes` are the numbers of serial reads and of bytes that are missing, as far as
    they were counted. `items` is the number of missing queue items.
    """

    event: Literal["opened", "failed", "gap"]
    kind: str = ""
    message: str = ""
    chunks: int = 0
    bytes: int = 0
    items: int = 0


class Entry(NamedTuple):
    """One message of a file. `topic`: topic of the message, without the name of the device."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes
