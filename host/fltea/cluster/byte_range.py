"""Understands the `Range` header with which fsspec asks a web server for a part of a file."""

import re
from collections.abc import Mapping

_RANGE = re.compile(r"bytes=(\d+)-(\d*)")


def requested_range(headers: Mapping[str, str]) -> tuple[int, int | None] | None:
    """Return the first and the last byte that a request asks for; None if it asks for the whole file.

    The last byte is None if the request asks for all bytes from the first on.
    """
    found = _RANGE.fullmatch(headers.get("Range", ""))
    return None if found is None else (int(found[1]), int(found[2]) if found[2] else None)
