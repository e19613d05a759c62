"""Decodes the messages that daemons publish; only the fields that a fleet uses are read, to save time.

Any client of the broker can publish anything, so the type and the length of every field are checked.
"""

import re
from typing import Annotated, Any, NamedTuple, get_args

import msgspec

from fltea.records.fit import VerdictKind
from fltea.records.visible import visible

LONGEST_ID = 64
"""Longest device ID [characters]; daemons use no longer IDs in their topics."""

LARGEST = 1 << 20
"""Largest payload [bytes]; a fit of three axes with its curves has 30 kB."""

MOST_AXES = 6
LONGEST_TEXT = 2000
LONGEST_WORD = 100
"""Longest name, state or reason [characters]; longer texts are shortened."""

VERDICTS = frozenset(get_args(VerdictKind))
OTHER = "other"
"""Replaces any verdict that this version does not know, so that the labels of metrics have few values."""

Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""A count that fits into a database's 64-bit integer."""


Points = Annotated[list[float], msgspec.Meta(max_length=1000)]
"""Values of a curve; a daemon sends a few dozen."""


class Status(msgspec.Struct, frozen=True):
    """Payload of a message `<prefix>/<device_id>/status`."""

    status: str
    source: str = ""
    device: str = ""
    reason: str | None = None


class Hello(msgspec.Struct, frozen=True):
    """Payload of a message `<prefix>/<device_id>/hello`."""

    rate_hz: float
    sensor: str | None = None
    boot_id: int | None = None
    firmware_version: str | None = None
    gyro_range_dps: float | None = None


class Interval(msgspec.Struct, frozen=True):
    """A parameter with the ends of its 95 % interval; an end is null where the data do not determine it."""

    value: float | None = None
    low: float | None = None
    high: float | None = None


class Allan(msgspec.Struct, frozen=True):
    """The Allan deviation, and the parameters N, B and K that follow from it."""

    tau_s: Points
    adev: Points
    low: Points
    high: Points
    N: float | None = None
    B: float | None = None
    K: float | None = None


class AxisFit(msgspec.Struct, frozen=True):
    """The fit of one axis."""

    verdict: str
    text: str
    unit: str
    alpha: Interval = Interval()
    f: Interval = Interval()
    R: Interval = Interval()
    allan: Allan | None = None


class Fit(msgspec.Struct, frozen=True):
    """Payload of a message `<prefix>/<device_id>/fit`."""

    seq: Count
    epoch: Count
    samples: Count
    axes: dict[str, AxisFit]


class Samples(msgspec.Struct, frozen=True):
    """Numbers of samples in a `stats` message."""

    delivered: Count = 0
    lost: Count = 0


class Tracker(msgspec.Struct, frozen=True):
    """The tracker's bias of an axis after the newest sample."""

    bias: float | None = None
    bias_std: float | None = None


class AxisStats(msgspec.Struct, frozen=True):
    """The part of a `stats` message about one axis."""

    tracker: Tracker | None = None


class Stats(msgspec.Struct, frozen=True):
    """Payload of a message `<prefix>/<device_id>/stats`."""

    sample_counts: Samples = Samples()
    axes: dict[str, AxisStats] = {}


class Error(msgspec.Struct, frozen=True):
    """Payload of a message `<prefix>/<device_id>/error`."""

    kind: str
    message: str = ""


Content = Status | Hello | Fit | Stats | Error

KINDS: dict[str, type[Content]] = {
    "status": Status,
    "hello": Hello,
    "fit": Fit,
    "stats": Stats,
    "error": Error,
}
"""Type of a message's content, by the last level of its topic."""

_DECODERS: dict[str, Any] = {kind: msgspec.json.Decoder(content) for kind, content in KINDS.items()}
_WORD = re.compile(r"[a-z0-9_/^. -]{1,40}", re.IGNORECASE)


class Message(NamedTuple):
    """One message of a device. `content` is None if the broker no longer retains the message."""

    device_id: str
    content: Content | None


class Bad(ValueError):
    """Raised for a message that no daemon sends; the text of the error is a short name of the reason."""


def read(topic: str, payload: bytes, prefix: str) -> Message:
    """Decode a message.

    Raises:
        Bad: the payload is too long, is not JSON or has wrong types, or the topic is not one of a daemon.
    """
    device_id, slash, kind = topic.removeprefix(f"{prefix}/").partition("/")
    if not slash or kind not in KINDS or not 1 <= len(device_id) <= LONGEST_ID or not device_id.isprintable():
        raise Bad("topic")
    if not payload:
        return Message(device_id, None)
    if len(payload) > LARGEST:
        raise Bad("too_long")
    try:
        content = _DECODERS[kind].decode(payload)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise Bad("content") from error
    return Message(device_id, _clean(content))


def _clean(content: Content) -> Content:
    """Return the content with unprintable characters removed and long texts cut, for pages and databases.

    Raises:
        Bad: an axis name or a unit in a fit has characters that no daemon uses.
    """
    if isinstance(content, Fit):
        return _clean_fit(content)
    fields = {name: getattr(content, name) for name in content.__struct_fields__}
    texts = {name: text for name, text in fields.items() if isinstance(text, str)}
    most = dict.fromkeys(texts, LONGEST_WORD) | {"message": LONGEST_TEXT}
    return msgspec.structs.replace(content, **{name: _line(text, most[name]) for name, text in texts.items()})


def _clean_fit(fit: Fit) -> Fit:
    """Check axis names and units, which become keys, labels and parts of pages, and clean the other texts."""
    if len(fit.axes) > MOST_AXES or not all(
        _WORD.fullmatch(word) for name, axis in fit.axes.items() for word in (name, axis.unit)
    ):
        raise Bad("content")
    axes = {
        name: msgspec.structs.replace(
            axis,
            verdict=axis.verdict if axis.verdict in VERDICTS else OTHER,
            text=_line(axis.text, LONGEST_TEXT),
        )
        for name, axis in fit.axes.items()
    }
    return msgspec.structs.replace(fit, axes=axes)


def _line(text: str, most: int) -> str:
    return visible(text[:most])[:most]
