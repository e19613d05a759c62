"""Lists recordings on any file system that fsspec supports.

For each recording, this module finds the address, the size and a stamp (a text that changes with the file).
"""

import hashlib
import os
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from fltea.recording.formats import KINDS
from fltea.records.errors import FlteaError, UsageError
from fltea.records.secret import refuse_secret
from fltea.settings.extras import how_to_install, load

PROTOCOLS = ("file", "s3", "s3a", "gs", "gcs", "abfs", "az", "http", "https", "memory")
"""Supported protocols. Chains (`zip::s3://…`) and protocols that run programs elsewhere are not supported."""
WEB = ("http", "https")
LIKE_NAMES = ("file", *WEB)
"""Protocols for which fsspec's path of a file is the complete address: /data/a.csv, https://a.org/b.csv. For
other protocols the path lacks the protocol.
"""
MAGIC, MAGIC_OF_WEB = re.compile(r"[*?\[]"), re.compile(r"[*\[]")
"""Characters that make a path a pattern. In a web address, `?` begins the query, so it is no pattern."""
LONGEST_NAME = 60
"""Longest name of a copied file, without its ending [characters]."""
STAMPS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "Last-Modified", "updated", "created")
"""Facts that fsspec gives about a file and that can serve as its stamp, a text that changes with the file.
The most reliable fact is first.
"""
MOST_LEVELS = 64
"""Deepest level of folders that is listed, since a server may invent folders or link back to the top."""
SILENT_S = 60.0
"""Longest time without data from a web server [s]."""
PACKAGES = {"gs": "gcsfs", "gcs": "gcsfs", "abfs": "adlfs", "az": "adlfs"}
"""Package that the user must install for a protocol, since no extra of fltea includes it."""
DESCRIBE = (".json", ".yaml", ".yml")
"""Endings of files that usually only describe recordings; such a file is read only if the user names it."""
JOURNAL = "_journal.ndjson"
"""Name of the journal, which is the file with new rows in the folder of a table of results.

Readers of Parquet ignore files whose names begin with `_`.
"""


class File(NamedTuple):
    """One listed file.

    `path`: path on its file system. `stamp`: text that changes with the file, "" if unknown.
    """

    url: str
    protocol: str
    path: str
    size: int
    stamp: str

    @property
    def suffix(self) -> str:
        """Ending of the file's name in small letters; "" if it has characters besides letters and digits."""
        found = PurePosixPath(self._name).suffix.lower()
        return found if re.fullmatch(r"\.[a-z0-9]{1,16}", found) else ""

    @property
    def copied_name(self) -> str:
        """Name for a copy: the file's name without unusual characters.

        The name is kept as far as possible, since some text formats are recognised by it. MCAP files and bags
        get the neutral name `recording`: from their own names, fltea would look for further parts of the same
        recording, but each file is read alone.
        """
        name = PurePosixPath(self._name).name.removesuffix(PurePosixPath(self._name).suffix)
        is_one = KINDS.get(self.suffix) not in ("mcap", "bag")
        stem = re.sub(r"[^a-zA-Z0-9_.-]+", "_", name)[:LONGEST_NAME].strip("._-") if is_one else ""
        return f"{stem or 'recording'}{self.suffix}"

    @property
    def _name(self) -> str:
        return self.path.partition("?")[0] if self.protocol in WEB else self.path


class Unlisted(NamedTuple):
    """A folder that could not be listed, and the reason."""

    folder: File
    reason: str


def file_system(protocol: str) -> Any:
    """Return the file system for a protocol. It does not cache lists of folders, which could be outdated.

    Raises:
        UsageError: the package for the protocol is not installed, or the protocol is not supported.
    """
    if protocol not in PROTOCOLS:
        raise UsageError(f"{protocol}://: not supported; supported are {', '.join(PROTOCOLS)}.")
    fsspec = load("fsspec", "fsspec", "cloud", "Files by URL need")
    try:
        options = _patience() if protocol in WEB else {}
        return fsspec.filesystem(protocol, use_listings_cache=False, **options)
    except ImportError as error:
        package = PACKAGES.get(protocol)
        install = how_to_install("cloud")
        if package is not None:
            install = f"{sys.executable} -m pip install {package}, here and on every worker"
        raise UsageError(
            f"{protocol}:// needs {package or 'a package'}, which is not installed ({error}): {install}."
        ) from error


def _patience() -> dict[str, Any]:
    """Return time and size limits for aiohttp, whose defaults allow 5 min without data and any size."""
    from aiohttp import ClientTimeout

    from fltea.cluster.bounded import BoundedResponse

    timeout = ClientTimeout(total=None, sock_connect=SILENT_S, sock_read=SILENT_S)
    return {"client_kwargs": {"timeout": timeout, "response_class": BoundedResponse}}


def files_of(patterns: Sequence[str]) -> Iterator[File | Unlisted]:
    """Yield the files of paths, URLs, patterns (`**` stands for any number of folders) and folders.

    For a folder, all files in it and in its subfolders that have the ending of a recording are listed. Links
    to folders in it are not followed; pipes, sockets and devices are skipped.

    Raises:
        UsageError: nothing is found, or a URL cannot be used.
        FlteaError: the file system cannot be reached, or refuses access.
    """
    for pattern in patterns:
        protocol, path = _split(pattern)
        system = file_system(protocol)
        found = 0
        try:
            for file in _matching(system, protocol, path):
                found += 1
                yield file
        except FileNotFoundError as error:  # fsspec also raises this if a web server does not answer
            cause = error.__cause__
            if cause is not None and getattr(cause, "status", 0) != 404:
                raise FlteaError(f"{pattern}: cannot be read ({type(cause).__name__}: {cause}).") from error
        except (FlteaError, GeneratorExit):
            raise
        # each file system has its own errors for wrong credentials, unknown names and network faults
        except Exception as error:
            raise FlteaError(f"{pattern}: cannot be listed ({type(error).__name__}: {error}).") from error
        if not found:
            raise UsageError(f"{pattern}: no recording is there.")


def _split(pattern: str) -> tuple[str, str]:
    protocol, separator, rest = pattern.partition("://")
    if not separator:
        return "file", pattern
    refuse_secret("FILE", pattern)
    if "::" in protocol:
        raise UsageError(f"{pattern}: chains of file systems are not read; name the file itself.")
    return protocol.lower(), pattern if protocol.lower() in WEB else rest


def _matching(system: Any, protocol: str, path: str) -> Iterator[File | Unlisted]:
    path = system._strip_protocol(path)
    if protocol == "file":
        path = _one_name(path)
    magic = (MAGIC if protocol not in WEB else MAGIC_OF_WEB).search(path)
    if magic is None or system.isfile(path):  # a path with brackets is no pattern if such a file exists
        about = system.info(path)
        if about["type"] != "directory":
            yield _file(system, protocol, about)
            return
        for one in _below(system, protocol, path, None):
            file = one if isinstance(one, Unlisted) else _file(system, protocol, one)
            if isinstance(file, Unlisted) or (file.suffix in KINDS and file.suffix not in DESCRIBE):
                yield file
        return
    from fsspec.utils import glob_translate

    fixed = path[: magic.start()].rpartition("/")[0]
    depth = None if "**" in path else path[len(fixed) :].strip("/").count("/")
    wanted = re.compile(glob_translate(path))
    for one in _below(system, protocol, fixed or system.root_marker, depth):
        if isinstance(one, Unlisted):
            yield one
        elif wanted.match(one["name"]):
            yield _file(system, protocol, one)


def _one_name(path: str) -> str:
    """Return a normalised path, so that a file named in two ways is read once."""
    before, parent, after = f"{path}/".rpartition("/../")
    return os.path.normpath(f"{os.path.realpath(before + parent)}/{after}" if parent else path)


def _below(system: Any, protocol: str, folder: str, depth: int | None) -> Iterator[dict[str, Any] | Unlisted]:
    """Yield the files of a folder and its subfolders in the order of their names, except tables of verdicts.

    `depth`: deepest level of folders; None: no limit.
    """
    folders = [(folder, 0)]
    seen = set()
    while folders:
        now, level = folders.pop()
        if now in seen:
            continue
        seen.add(now)
        if level > MOST_LEVELS:
            reason = f"lies {MOST_LEVELS} folders deep; does the server make folders up? Name a deeper folder"
            yield Unlisted(File(_url(protocol, now), protocol, now, -1, ""), reason)
            continue
        try:
            inside = sorted(system.ls(now, detail=True), key=lambda one: str(one["name"]))
        except (FileNotFoundError, PermissionError) as error:
            if level == 0:
                raise
            if isinstance(error, PermissionError):  # a folder that no longer exists is skipped
                reason = f"cannot be listed ({type(error).__name__}: {error})"
                yield Unlisted(File(_url(protocol, now), protocol, now, -1, ""), reason)
            continue
        if any(str(one["name"]).endswith(f"/{JOURNAL}") for one in inside):
            continue
        below = []
        for one in inside:
            about = _of_its_target(system, one)
            if about["type"] == "directory":
                if (depth is None or level < depth) and not about.get("islink"):
                    below.append((one["name"], level + 1))
            elif about["type"] != "other" and one["name"].rstrip("/") != now.rstrip("/"):
                yield about
        folders += reversed(below)


def _of_its_target(system: Any, about: dict[str, Any]) -> dict[str, Any]:
    """Return facts about a file. For a link, return the facts about the file to which the link leads."""
    if not about.get("islink"):
        return about
    try:
        found: dict[str, Any] = system.info(about["name"])
    except OSError:  # the link leads nowhere; the error is reported when the file is read
        return {**about, "type": "file"}
    return found


def _file(system: Any, protocol: str, about: dict[str, Any]) -> File:
    name = str(about["name"])
    if about.get("size") is None:  # a web server's list has no sizes, so ask for each file
        about = system.info(name)
    stamp = next((str(about[key]) for key in STAMPS if about.get(key)), "")
    size = about.get("size")
    return File(_url(protocol, name), protocol, name, -1 if size is None else int(size), stamp)


def _url(protocol: str, name: str) -> str:
    url = name if protocol in LIKE_NAMES else f"{protocol}://{name.lstrip('/')}"
    if protocol in WEB and "?" in url:  # the text after "?" may be a secret, so the table has only its digest
        place, _, query = url.partition("?")
        url = f"{place}?…{hashlib.blake2b(query.encode(), digest_size=4).hexdigest()}"
    return url.encode(errors="replace").decode()  # a name may hold bytes that are no valid text
