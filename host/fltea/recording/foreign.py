"""Formats of other programs, each by the library that is kept for it: run as a program by `apart`.

stdout: pieces, each behind its length in four bytes. The first is a `Head` as JSON. Then come lines of text,
or after a line of JSON on stdin, the places of the columns that are wanted, rows of their numbers. The length
0 ends them; FAILED stands before a reason.
"""

import resource
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from fltea.recording.apart import FAILED, LENGTH, Head
from fltea.recording.formats import FORMATS, loaded
from fltea.recording.readers.arrays import MOST_WIDE
from fltea.recording.sheet import SAMPLE_ROWS, Sheet
from fltea.records.errors import UsageError


def main(seconds: str, memory: str, kind: str, path: str, topic: str) -> None:
    """Read a file within so much processor time and address space, and write nothing but to stdout."""
    for what, most in (
        (resource.RLIMIT_CPU, int(seconds)),
        (resource.RLIMIT_AS, int(memory)),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    try:
        found: Sheet | Iterator[bytes] = loaded(FORMATS[kind].reader)(Path(path), topic)
        if isinstance(found, Sheet):
            names, units, rows, _, stamps, rate_hz, _ = found
            _send(msgspec.json.encode(Head(names, units, rows, list(stamps), rate_hz, _sample(found))))
            places = msgspec.json.decode(sys.stdin.buffer.readline() or b"[]", type=list[int])
            for values in found.blocks(places) if places else ():
                _send(np.ascontiguousarray(values).tobytes())
        else:
            _send(msgspec.json.encode(Head(text=True)))
            for data in found:
                _send(data)
        _send(b"")
    except BrokenPipeError:
        pass
    except UsageError as error:
        _fail(str(error))
    except MemoryError:
        _fail(f"more than the {int(memory) / 1e9:.1f} GB would be needed that a file of its size may take.")
    except Exception as error:  # whatever a library raises on damaged bytes
        reason = str(error).partition("\n")[0] or type(error).__name__
        _fail(f"cannot be read as {FORMATS[kind].title} ({reason}).")


def _sample(sheet: Sheet) -> list[list[float | None]]:
    """The first rows, with null where there are no numbers."""
    columns: list[list[float | None]] = []
    count = min(SAMPLE_ROWS, sheet.rows)
    for place in range(min(len(sheet.names), MOST_WIDE)):
        try:
            values = next(iter(sheet.blocks([place])))[:count, 0]
            columns.append([float(value) if np.isfinite(value) else None for value in values])
        except (UsageError, ValueError, StopIteration):
            columns.append([None] * count)
    return [list(row) for row in zip(*columns, strict=True)]


def _send(data: bytes) -> None:
    sys.stdout.buffer.write(LENGTH.pack(len(data)) + data)
    sys.stdout.buffer.flush()


def _fail(reason: str) -> None:
    sys.stdout.buffer.write(LENGTH.pack(FAILED) + reason.encode(errors="replace"))
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
