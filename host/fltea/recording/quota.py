"""Limits of memory and time for reading one file. All readers have them, since a file can claim anything.

- **Memory** and temporary files: at most `replay.max_mb`, whatever the file's size.
- **Decompressed data**: the same limit, and at most `RATIO` times the size of the file. Sensor readings
  contain noise, so they compress at most to a tenth. A few bytes that decompress to a gigabyte are no
  recording.
- **Processor time**, where a file can make a reader loop (SQLite, messages with a schema, libraries for other
  formats): `Limits.seconds`, plus `SECONDS_PER_MB` for each megabyte and `SECONDS_PER_MESSAGE` for each
  message. Reading a large recording takes a hundredth of this time.
- **Fields** of one message: `MOST_FIELDS`, since a short schema can declare thousands of fields.

The operating system applies these limits to a reader process: see `process_limits`.
"""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from fltea.records.errors import UsageError
from fltea.settings.limits import MB, Limits

RATIO, SMALLEST_BYTES = 200, 4 * MB
"""RATIO: decompressed data may be at most this many times as large as the compressed data. SMALLEST_BYTES:
decompressed data up to this size are always allowed [bytes].
"""

SECONDS_PER_MB = 5.0
SECONDS_PER_MESSAGE = 0.005

MOST_FIELDS = 1000
"""Largest number of fields in one message, including nested fields. Even a message with a robot's whole state
has only a few hundred.
"""

T = TypeVar("T")


class TooManyFields(ValueError):
    """Raised for a message that has more than `MOST_FIELDS` fields."""

    def __init__(self) -> None:
        super().__init__(
            f"a message has more than {MOST_FIELDS} fields, too many to search for those of a gyroscope. "
            "Write the gyroscope's fields to messages of their own"
        )


class Quota:
    """Counts the memory and the processor time that reading a file has taken so far.

    `size_bytes`: size of the file if the path does not give it.
    """

    def __init__(self, path: Path, limits: Limits, size_bytes: int | None = None) -> None:
        self.path, self.limits = path, limits
        self.size_bytes = path.stat().st_size if size_bytes is None else size_bytes
        self.seconds = limits.seconds + SECONDS_PER_MB * self.size_bytes / MB
        self._begin_s = time.thread_time()
        self._unpacked = 0

    def unpack(self, size_bytes: int) -> None:
        """Count decompressed bytes.

        Raises:
            UsageError: more bytes were decompressed than are allowed.
        """
        self._unpacked += size_bytes
        if self._unpacked > self.limits.whole_bytes:
            raise self.limits.whole_too_large(str(self.path), self._unpacked)
        if self._unpacked > max(SMALLEST_BYTES, RATIO * self.size_bytes):
            raise UsageError(
                f"{self.path}: unpacks to more than {RATIO} times its size of {self.size_bytes} bytes, which "
                "no recording does. It is damaged, or made to fill the memory of whoever opens it."
            )

    def messages(self, messages: Iterable[T]) -> Iterator[T]:
        """Yield messages as long as processor time for decoding them is left.

        Raises:
            UsageError: decoding took too much time.
        """
        for one in messages:
            self.check()
            yield one
            self.seconds += SECONDS_PER_MESSAGE

    def check(self) -> None:
        """Raise UsageError if reading has taken too much time."""
        if self.is_over():
            raise self.too_slow()

    def is_over(self) -> bool:
        """Return whether reading has taken more of this thread's processor time than allowed."""
        return time.thread_time() - self._begin_s > self.seconds

    def too_slow(self) -> UsageError:
        """Return the error to raise if reading took too much time."""
        return UsageError(
            f"{self.path}: reading its {self.size_bytes / MB:.3g} MB took more than {self.seconds:.0f} s of "
            "processor time, which no recording does. It is damaged, or made to keep whoever opens it busy."
        )
