"""Encode a record as JSON, for lines of text and for messages."""

import re

import msgspec

OBJECTS = (
    *("allan", "spectrum", "low_pass", "high_pass", "until_s"),
    *("estimator", "accel_estimator"),
    *("board", "device_estimator", "tracker"),
)
"""Fields that hold an object or None. A field that is None is left out of the JSON. Otherwise the Arrow
library could not read a file in which the field is null for the first megabyte and an object later.
"""
ABSENT = re.compile(rb',"(?:%b)":null|"(?:%b)":null,' % (("|".join(OBJECTS).encode(),) * 2))

_encode = msgspec.json.Encoder().encode


def record_json(record: object) -> bytes:
    """Return a record as JSON, without those fields of `OBJECTS` that are None."""
    return ABSENT.sub(b"", _encode(record))
