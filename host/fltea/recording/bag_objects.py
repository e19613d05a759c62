"""Reads JSON and protobuf messages of MCAP files that programs other than ROS write.

Fields are found by their names, like columns of text files. No convention gives their units. So the units
come from the names, from the schema's descriptions, or from the user.
"""

from collections.abc import Callable, Container, Iterator, Sequence
from functools import lru_cache, partial
from typing import Any

import msgspec
import numpy as np

from fltea.recording.bag_imu import FRAME, Imu
from fltea.recording.bag_names import Layout, Texts, named_layout
from fltea.recording.column_names import is_time, named_axis, tells_sensors
from fltea.recording.one_sensor import as_float, as_word
from fltea.recording.quota import MOST_FIELDS, Quota, TooManyFields
from fltea.recording.readers.file_facts import scale_of, units_of
from fltea.recording.text_labels import DEEPEST, decode_object, units_beside, without_axis
from fltea.recording.text_times import with_seconds
from fltea.records.records import AXES
from fltea.settings.extras import load

Decoder = Callable[[bytes], dict[str, Any]]

WORDS = "description", "title", "unit", "units", "x-unit", "$comment"
"""Keywords of JSON Schema whose text describes a field."""

MOST_OTHERS = 16
"""A sensor's name or number may stand in a field whose own name does not suggest this. At most this number of
such fields of a message is examined.
"""

MOST_TRIED, MOST_TEXTS = 100, 10_000
"""At most MOST_TRIED messages are searched for angular rates. At most MOST_TEXTS texts of a schema are read.
"""


def layout_of(
    messages: Sequence[bytes], encoding: str, kind: str, schema: bytes, sensor: str | None, quota: Quota
) -> Layout | None:
    """Return the layout of the first message that holds angular rates; None if there is no such message.

    `kind`, `schema`: type and schema of the messages, from their MCAP channel. `sensor`: the gyroscope to
    read if a message holds several.

    Raises:
        TooManyFields: a message has more fields than are examined.
        UsageError: the axes of one sensor state different units, or decoding took too much time.
    """
    decode = _decoder(encoding, kind, schema)
    texts = (_texts_of_json if encoding == "json" else _texts_of_protobuf)(kind, schema)
    tried = set[tuple[str, ...]]()
    for message in quota.messages(messages[:MOST_TRIED]):
        try:
            found = decode(message)
        except TooManyFields:
            raise
        except (ValueError, RecursionError):
            continue
        if (names := tuple(found)) in tried:
            continue
        tried.add(names)
        said = Texts(partial(_about, texts), dict(zip(found, units_beside(found), strict=True)).__getitem__)
        layout = named_layout(list(found), kind, said, sensor)
        if layout is not None:
            is_date = len(layout.time) == 1 and _as_number(found[layout.time[0]])[1]
            fixed = tuple((name, str(value)) for name, value in found.items() if units_of({name: value}))
            rate, labels = layout.rate.unit if layout.rate else "", layout.gyro
            is_whole = all(_is_whole(found[name]) for name in labels)
            changed = scale_of(found, without_axis(labels[0]), labels, rate, is_whole=is_whole)
            tell, others = _telling(
                found, {*layout.time, *labels, *layout.accel, *(name for name, _ in fixed)}
            )
            layout = layout._replace(tell=tell, others=others, fixed=fixed, changed=changed)
            return layout._replace(time_s=(1.0,)) if is_date else layout
    return None


def _is_whole(value: Any) -> bool:
    return type(value) is int or (isinstance(value, float) and value.is_integer())


def _telling(found: dict[str, Any], known: Container[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return fields whose names show that they distinguish sensors, and other fields that perhaps do.

    The fields of the second kind hold texts or whole numbers. A field frame_id that holds a number is of the
    second kind, since it may count images.
    """
    free = [name for name, value in found.items() if name not in known and type(value) in (str, int)]
    tell = [name for name in free if tells_sensors(name) or name.rpartition(".")[2] == FRAME]
    tell = [name for name in tell if name.rpartition(".")[2] != FRAME or isinstance(found[name], str)]
    others = [name for name in free if name not in tell and not is_time(name)]
    return tuple(tell), tuple(others[:MOST_OTHERS])


def read_objects(
    messages: Sequence[bytes], layout: Layout, encoding: str, kind: str, schema: bytes, quota: Quota
) -> Imu:
    """Read messages in the file's order. Messages that do not fit the layout are left out.

    The JSON value null is read as a missing number.

    Raises:
        UsageError: reading takes too much time.
    """
    decode = _decoder(encoding, kind, schema)
    names = [*layout.time, *layout.gyro, *layout.accel]
    rows, numbers, told = [], [], []
    for row, message in enumerate(quota.messages(messages)):
        try:
            found = decode(message)
            line = [_as_number(found.get(name) if name in layout.accel else found[name])[0] for name in names]
        # msgspec's and protobuf's errors are ValueErrors
        except (ValueError, KeyError, TypeError, RecursionError):
            continue
        if any(str(found.get(name)) != text for name, text in layout.fixed):
            continue
        rows.append(row)
        numbers.append(line)
        told.append([_as_word(found.get(name)) for name in (*layout.tell, *layout.others)])
    values = np.array(numbers, np.float64).reshape(-1, len(names))
    begin = len(layout.time)
    accel = values[:, begin + 3 :] if layout.accel else np.zeros((len(rows), 3))
    has_accel = np.full(len(rows), bool(layout.accel))
    return Imu(
        np.array(rows, np.int64),
        values[:, :begin],
        values[:, begin : begin + 3],
        accel,
        np.ones(len(rows), np.bool_),
        has_accel,
        tuple(np.array(one, np.str_) for one in zip(*told, strict=True)),
    )


def _as_word(value: Any) -> str:
    return as_word(value) if type(value) in (int, float) else str(value or "")


def _as_number(value: Any) -> tuple[float, bool]:
    """Return a value as a number, and whether it is a date. A date is converted to seconds.

    A text may stand for a number, since protobuf's JSON form writes int64 as text.

    Raises:
        ValueError, TypeError: the value is not a number.
    """
    if value is None:
        return np.nan, False
    if isinstance(value, str):
        text = with_seconds(value)
        return float(text), text != value
    return as_float(value), False


def _decoder(encoding: str, kind: str, schema: bytes) -> Decoder:
    return _decode_json if encoding == "json" else decoder_of(kind, schema)


def _decode_json(data: bytes) -> dict[str, Any]:
    found = decode_object(data)
    if len(found) > MOST_FIELDS:
        raise TooManyFields
    return found


def _about(texts: dict[str, str], name: str) -> Iterator[str]:
    """Yield the description of a field, and then of the fields that contain it."""
    while name:
        yield texts.get(name, "")
        name = name.rpartition(".")[0]
    yield texts.get("", "")


def _texts_of_json(_: str, schema: bytes) -> dict[str, str]:
    """Return the descriptions in a JSON Schema. The keys are the field names that `decode_object` gives."""
    texts: dict[str, str] = {}
    try:
        whole = msgspec.json.decode(schema)
    except (ValueError, RecursionError):
        return texts
    definitions = {}
    for key in ("$defs", "definitions"):
        known = whole.get(key) if isinstance(whole, dict) else None
        for name, definition in known.items() if isinstance(known, dict) else ():
            definitions[f"#/{key}/{name}"] = definition

    def add(name: str, part: Any, depth: int) -> None:
        if not isinstance(part, dict) or not depth or len(texts) > MOST_TEXTS:
            return
        said = [str(part[word]) for word in WORDS if isinstance(part.get(word), str)]
        for place in (name, *(named_axis(name, axis) for axis in range(len(AXES) if name else 0))):
            texts[place] = " ; ".join(filter(None, [texts.get(place), *said]))
        if "$ref" in part:
            add(name, definitions.get(str(part["$ref"])), depth - 1)
        inner = part.get("properties")
        for key, value in inner.items() if isinstance(inner, dict) else ():
            add(f"{name}.{key}" if name else key, value, depth - 1)

    add("", whole, DEEPEST)
    return texts


def _texts_of_protobuf(kind: str, schema: bytes) -> dict[str, str]:
    """Return a protobuf schema's comments on a message type (key "") and on its fields (by name)."""
    files, texts = _files_of(schema), dict[str, str]()
    for file in files.file if files is not None else ():
        for number, message in enumerate(file.message_type):
            if kind != f"{file.package}.{message.name}".lstrip("."):
                continue
            for place in file.source_code_info.location:
                said = f"{place.leading_comments} {place.trailing_comments}"
                match list(place.path):
                    case [4, n] if n == number:
                        texts[""] = said
                    case [4, n, 2, k] if n == number and k < len(message.field):
                        texts[message.field[k].name] = said
    return texts


def _files_of(schema: bytes) -> Any:
    load("google.protobuf", "google", "ros", "Messages of protobuf need")
    from google.protobuf import descriptor_pb2

    try:
        return descriptor_pb2.FileDescriptorSet.FromString(schema)
    # protobuf's DecodeError has no specific base class; `decoder_of` reports the error
    except Exception:
        return None


def _fields_left(message: Any, most: int) -> int:
    """Return `most` less the number of a message's fields, including those of nested messages.

    Fields that the message's type has, but the message lacks, are counted, too.
    """
    left = most - len(message.DESCRIPTOR.fields)
    for field, value in message.ListFields() if left >= 0 else ():
        if field.message_type is None:
            continue
        parts = [value] if hasattr(value, "ListFields") else value
        for part in parts.values() if hasattr(parts, "values") else parts:
            left = _fields_left(part, left) if hasattr(part, "ListFields") else left - 1
            if left < 0:
                break
    return left


@lru_cache(maxsize=8)
def decoder_of(kind: str, schema: bytes) -> Decoder:
    """Return a function that decodes messages of type `kind`, described by the FileDescriptorSet `schema`.

    Raises:
        UsageError: the protobuf library is not installed.
    """
    files = _files_of(schema)
    from google.protobuf import descriptor_pool, json_format, message_factory

    pool = descriptor_pool.DescriptorPool()
    try:
        for file in files.file:
            pool.Add(file)
        message_class = message_factory.GetMessageClass(pool.FindMessageTypeByName(kind))
    except Exception as error:  # protobuf raises various errors for damaged schemas
        reason = str(error)

        def refuse(_: bytes) -> dict[str, Any]:
            raise ValueError(reason)

        return refuse

    def decode(data: bytes) -> dict[str, Any]:
        try:
            message = message_class.FromString(data)
            if _fields_left(message, MOST_FIELDS) < 0:
                raise TooManyFields
            found = json_format.MessageToDict(
                message,
                preserving_proto_field_name=True,
                always_print_fields_with_no_presence=True,
            )
        except TooManyFields:
            raise
        except Exception as error:  # protobuf's DecodeError has no specific base class
            raise ValueError(str(error)) from error
        return decode_object(msgspec.json.encode(found))

    return decode
