"""The bytes of a file as it was listed: what changes meanwhile is told, and makes no row of two contents.

A web server is asked for that very content (`If-Match`, `If-Unmodified-Since`), and what each of its answers
says of it is compared, since not all servers look at what they are asked. Of other files it is looked up
whether they are as they were, before and after reading; S3's file system pins the content by itself.
"""

import contextlib
import re
from collections.abc import Awaitable, Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from fltea.cluster.listing import STAMPS, WEB, File, file_system
from fltea.cluster.whole_ranges import WholeRanges
from fltea.records.errors import FlteaError

PINNED = ("s3", "s3a")
CHANGED_STATUS = (412, 416)
"""Precondition failed, and a range that is not in the file: it has become shorter."""
RANGE = re.compile(r"bytes (\d+)-\d+/(\d+|\*)")
ASKED = re.compile(r"bytes=(\d+)-")


@contextlib.contextmanager
def open_bytes(file: File, *, whole: bool = False) -> Iterator[BinaryIO]:
    """Open a file for ranges; nothing is read ahead. whole: it is read once, from its beginning to its end.

    Raises:
        FlteaError: it is not what it was when it was listed; while it is read, a range does not come whole.
        OSError: the file system failed; it may raise others.
    """
    system = file_system(file.protocol)
    if file.protocol in WEB:
        # One answer is of one content; with a size given, the server is not asked for it again.
        blocks = {"block_size": 0} if whole else {}
        asked = {"headers": _conditions(file), "raise_for_status": _check_of(file)}
        with system.open(
            file.path, "rb", cache_type="none", size=max(file.size, 1), **blocks, **asked
        ) as stream:
            yield stream
        return
    is_pinned = file.protocol in PINNED
    with _opened(system, file) as stream:
        _check(file, stream.details if is_pinned else system.info(file.path))
        yield stream if file.protocol == "file" else WholeRanges(file, stream)  # type: ignore[misc]
        if not is_pinned:
            _check(file, system.info(file.path))


def _opened(system: Any, file: File) -> Any:
    if file.protocol == "file":
        return Path(file.path).open("rb", buffering=0)
    return system.open(file.path, "rb", cache_type="none")


def changed(file: File) -> FlteaError:
    """What to raise where a file is another one now."""
    return FlteaError(
        f"{file.url}: has changed since it was listed, so nothing of it is used. Run the same command again "
        "when nobody writes it."
    )


def _check(file: File, about: Mapping[str, Any]) -> None:
    size = about.get("size")
    has_grown = (
        file.protocol == "file" and size is not None and size > file.size >= 0
    )  # what was there, stays
    known = {_bare(str(about[key])) for key in STAMPS if about.get(key)}  # a list may say less than a look-up
    is_other = bool(file.stamp and known) and _bare(file.stamp) not in known
    if (is_other and not has_grown) or (size is not None and 0 <= size < file.size):
        raise changed(file)


def _is_tag(stamp: str) -> bool:
    return stamp.endswith('"')


def _conditions(file: File) -> dict[str, str]:
    """What a request says of the content that is wanted. A weak tag fits no `If-Match`."""
    found = {"Accept-Encoding": "identity"}  # what is packed on the way has other ranges, and another tag
    if file.stamp.startswith('"') and _is_tag(file.stamp):
        found["If-Match"] = file.stamp
    elif file.stamp.endswith("GMT"):
        found["If-Unmodified-Since"] = file.stamp
    return found


def _check_of(file: File) -> Callable[[Any], Awaitable[None]]:
    """Return what looks at the head of each answer, and raises FlteaError if its content is another one."""
    seen: dict[str, str] = {}
    if file.stamp:
        seen["ETag" if _is_tag(file.stamp) else "Last-Modified"] = file.stamp

    async def check(answer: Any) -> None:
        if answer.status in CHANGED_STATUS:
            raise changed(file)
        if answer.status >= 300:
            return  # an error, which fsspec tells
        for name in ("ETag", "Last-Modified"):
            value = answer.headers.get(name)
            if value and _bare(seen.setdefault(name, value)) != _bare(value):
                raise changed(file)
        part = RANGE.fullmatch(answer.headers.get("Content-Range", ""))
        asked = ASKED.match(answer.request_info.headers.get("Range", ""))
        if part and asked and part[1] != asked[1]:
            raise FlteaError(f"{file.url}: its server sends other bytes than those that it is asked for.")
        length = part[2] if part else answer.headers.get("Content-Length", "")
        if (part or not asked) and length.isdecimal() and file.size >= 0 and int(length) != file.size:
            raise changed(file)

    return check


def _bare(tag: str) -> str:
    """Return a tag without what only some of those who state it put around it."""
    return tag.removeprefix("W/").strip('"')
