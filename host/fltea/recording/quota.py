"""What reading one file may cost. It is one rule for every reader, since a file can claim what it likes.

- **Kept** in memory or in temporary files: at most `replay.max_mb`, whatever the file's own size.
- **Unpacked**: as much, and no more than `RATIO` times the size of the file. Readings of a sensor are noise,
  which packs ten times at most; a few bytes that unpack to a gigabyte are no recording.
- **Processor time**, where a reader may be sent round in circles (SQLite, messages that a schema describes,
  libraries for other people's formats): `Limits.seconds` and `SECONDS_PER_MB` for every megabyte of the file,
  and `SECONDS_PER_MESSAGE`. That is a hundred times what a large recording takes.
- **Fields** of one message: `MOST_FIELDS`, since a schema can say that a message of some bytes has thousands.

A process apart is held to these by the system: `process_limits`.
"""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from fltea.records.errors import UsageError
from fltea.settings.limits import MB, Limits

RATIO, SMALLEST_BYTES = 200, 4 * MB
"""Of what is unpacked to what is packed. So much any file may unpack to: a short file of zeros is no harm."""

SECONDS_PER_MB = 5.0
SECONDS_PER_MESSAGE = 0.005

MOST_FIELDS = 1000
"""Of one message, those in its parts among them. A robot's whole state has some hundreds."""

T = TypeVar("T")


class TooManyFields(ValueError):
    """A message has more fields than are looked at."""

    def __init__(self) -> None:
        super().__init__(
            f"a message has more than {MOST_FIELDS} fields, and so many are not looked through for a "
            "gyroscope's. Write the gyroscope's to messages of their own"
        )


class Quota:
    """Counts what reading one file has cost so far. size_bytes: of it, if it is not behind the path."""

    def __init__(self, path: Path, limits: Limits, size_bytes: int | None = None) -> None:
        self.path, self.limits = path, limits
        self.size_bytes = path.stat().st_size if size_bytes is None else size_bytes
        self.seconds = limits.seconds + SECONDS_PER_MB * self.size_bytes / MB
        self._begin_s = time.thread_time()
        self._unpacked = 0

    def unpack(self, size_bytes: int) -> None:
        """Count bytes that were unpacked.

        Raises:
            UsageError: they are too many.
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
        """Yield messages that are to be decoded, each while there is time left for it.

        Raises:
            UsageError: they took too much.
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
        """Whether reading has taken more of this thread's processor time than it may."""
        return time.thread_time() - self._begin_s > self.seconds

    def too_slow(self) -> UsageError:
        """What to raise then."""
        return UsageError(
            f"{self.path}: reading its {self.size_bytes / MB:.3g} MB took more than {self.seconds:.0f} s of "
            "processor time, which no recording does. It is damaged, or made to keep whoever opens it busy."
        )
