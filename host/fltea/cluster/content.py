"""Reads a file exactly as it was listed.

A file that has changed since it was listed gives an error. So no result mixes two contents of a file.

Requests to a web server name the listed content (`If-Match`, `If-Unmodified-Since`). The headers of each
answer are compared too, since not all servers honour such requests. Other files are compared before and after
reading. The file system for S3 itself reads only the listed content.
"""

import contextlib
import re
from collections.abc import Awaitable, Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from fltea.cluster.byte_range import requested_range
from fltea.cluster.listing import STAMPS, WEB, File, file_system
from fltea.cluster.whole_ranges import WholeRanges
from fltea.records.errors import FlteaError

PINNED = ("s3", "s3a")
CHANGED_STATUS = (412, 416)
"""HTTP status codes: 412 for a failed precondition, and 416 for a range beyond the end of a shortened
file."""
CONTENT_RANGE = re.compile(r"bytes (\d+)-\d+/(\d+|\*)")


@contextlib.contextmanager
def open_bytes(file: File, *, whole: bool = False) -> Iterator[BinaryIO]:
    """Open a file for reading ranges of bytes, without reading ahead.

    `whole`: whether the file is read once, from its beginning to its end.

    Raises:
        FlteaError: the file changed since it was listed, or a range arrives incomplete.
        OSError: the file system failed; it may raise other errors, too.
    """
    system = file_system(file.protocol)
    if file.protocol in WEB:
        # With block size 0 the file comes in one answer, whose bytes all belong to the same content. If the
        # size is passed to fsspec, it does not ask the server for the size.
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
    """Return the error to raise for a file that changed."""
    return FlteaError(
        f"{file.url}: has changed since it was listed, so nothing of it is used. Run the same command again "
        "when no program writes to the file."
    )


def _check(file: File, about: Mapping[str, Any]) -> None:
    size = about.get("size")
    has_grown = (
        file.protocol == "file" and size is not None and size > file.size >= 0
    )  # a local file that only grew still has the listed bytes
    # The listing took one of the facts `STAMPS` as the stamp of the file. It may be any of those in `about`.
    known = {_bare(str(about[key])) for key in STAMPS if about.get(key)}
    is_other = bool(file.stamp and known) and _bare(file.stamp) not in known
    if (is_other and not has_grown) or (size is not None and 0 <= size < file.size):
        raise changed(file)


def _is_tag(stamp: str) -> bool:
    return stamp.endswith('"')


def _conditions(file: File) -> dict[str, str]:
    """Return the request headers that name the listed content.

    A weak entity tag is not used, since `If-Match` does not accept it.
    """
    # ask for uncompressed data: compressed data have other byte ranges and entity tags
    found = {"Accept-Encoding": "identity"}
    if file.stamp.startswith('"') and _is_tag(file.stamp):
        found["If-Match"] = file.stamp
    elif file.stamp.endswith("GMT"):
        found["If-Unmodified-Since"] = file.stamp
    return found


def _check_of(file: File) -> Callable[[Any], Awaitable[None]]:
    """Return a function that checks the headers of each answer and raises FlteaError if the file changed."""
    seen: dict[str, str] = {}
    if file.stamp:
        seen["ETag" if _is_tag(file.stamp) else "Last-Modified"] = file.stamp

    async def check(answer: Any) -> None:
        if answer.status in CHANGED_STATUS:
            raise changed(file)
        if answer.status >= 300:
            return  # no error here: fsspec reports HTTP errors (status 400 and above) itself
        for name in ("ETag", "Last-Modified"):
            value = answer.headers.get(name)
            if value and _bare(seen.setdefault(name, value)) != _bare(value):
                raise changed(file)
        part = CONTENT_RANGE.fullmatch(answer.headers.get("Content-Range", ""))
        asked = requested_range(answer.request_info.headers)
        if part and asked and part[1] != str(asked[0]):
            raise FlteaError(f"{file.url}: its server sends other bytes than those that it is asked for.")
        length = part[2] if part else answer.headers.get("Content-Length", "")
        if (part or not asked) and length.isdecimal() and file.size >= 0 and int(length) != file.size:
            raise changed(file)

    return check


def _bare(tag: str) -> str:
    """Return an entity tag without its quotes and its mark for weak tags; not all servers write these."""
    return tag.removeprefix("W/").strip('"')
