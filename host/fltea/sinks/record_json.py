"""A record as JSON, for lines of text and for messages."""

import re

import msgspec

OBJECTS = (
    *("allan", "spectrum", "low_pass", "high_pass", "until_s"),
    *("estimator", "accel_estimator"),
    *("board", "device_estimator", "tracker"),
)
"""Objects that a record may be without. Arrow refuses one that is null for a megabyte and then an object."""
ABSENT = re.compile(rb',"(?:%b)":null|"(?:%b)":null,' % (("|".join(OBJECTS).encode(),) * 2))

_encode = msgspec.json.Encoder().encode


def record_json(record: object) -> bytes:
    """Return a record without objects that there are not."""
    return ABSENT.sub(b"", _encode(record))
