"""Makes JSON schemas for the record channels of an MCAP file, which Foxglove and PlotJuggler can read.

Foxglove's reader of JSON schemas accepts objects, lists and scalars. It accepts neither references to other
schemas nor alternatives such as "number or null". So each reference is replaced by the schema to which it
refers. A field that is a number or null, for example, is declared as a number. If the field is null in a
record, the message of this record lacks the field.
"""

import functools
import re
from typing import Any

import msgspec

from fltea.records.records import ACCEL_AXES, AXES

NAMED = {"axes": AXES + ACCEL_AXES}
"""Fields of records that hold one value for each axis, with the names of the axes. The schema lists these
names, since a program that plots values has to offer them to its user.
"""

NULL = re.compile(rb',"\w+":null|"\w+":null,?')
"""Matches a field that is null, in JSON without blanks. It never matches inside a text, since JSON escapes
the quotation marks in texts.
"""

_encode = msgspec.json.Encoder().encode


@functools.cache
def record_schema(kind: type[msgspec.Struct]) -> bytes:
    """Return the JSON schema of one class of records, in MCAP's schema encoding "jsonschema"."""
    (root,), definitions = msgspec.json.schema_components([kind], ref_template="{name}")
    plain = _plain(root, definitions)
    assert plain is not None
    return _encode({"title": kind.__name__, **plain})


def encode_message(record: msgspec.Struct) -> bytes:
    """Return a record as a message: the record's JSON without null fields."""
    return NULL.sub(b"", _encode(record))


def _plain(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    """Return the same JSON schema without references, and without null as an alternative.

    Return None if several types remain as alternatives.
    """
    if "$ref" in schema:
        return _plain(definitions[schema["$ref"]], definitions)
    if "anyOf" in schema:
        options = [option for option in schema["anyOf"] if option != {"type": "null"}]
        return _plain(options[0], definitions) if len(options) == 1 else None
    match schema.get("type"):
        case "object":
            return _plain_object(schema, definitions)
        case "array":
            items = _plain(
                schema["items"] or schema["prefixItems"][0], definitions
            )  # the first item stands for all: in fltea's records, all items of a tuple have one type
            return None if items is None else {"type": "array", "items": items}
        case None:  # a schema without a type lists the words that the value may be
            words = [word for word in schema["enum"] if word is not None]
            return {"type": "string", "enum": words}
        case kind:
            return {"type": kind}


def _plain_object(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    properties, required = {}, []
    for name, field in schema.get("properties", {}).items():
        plain = _plain(field, definitions)
        if plain is None:
            continue
        if name in NAMED:
            value = _plain(_values(field), definitions)
            plain = {"type": "object", "properties": dict.fromkeys(NAMED[name], value)}
        properties[name] = plain
        if name in schema.get("required", ()) and not _nullable(field):
            required.append(name)
    return {"type": "object", "properties": properties, "required": required}


def _values(field: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of the values in an object whose keys are names."""
    options = field.get("anyOf", [field])
    values: dict[str, Any] = next(o["additionalProperties"] for o in options if "additionalProperties" in o)
    return values


def _nullable(field: dict[str, Any]) -> bool:
    return {"type": "null"} in field.get("anyOf", ()) or None in field.get("enum", ())
