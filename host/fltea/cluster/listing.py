"""Which recordings there are, on any file system that fsspec reaches: their address, size and stamp."""

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
"""Chains (`zip::s3://…`) and protocols that run programs elsewhere are none of these."""
WEB = ("http", "https")
LIKE_NAMES = ("file", *WEB)
"""What they call a file is its address."""
MAGIC, MAGIC_OF_WEB = re.compile(r"[*?\[]"), re.compile(r"[*\[]")
"""Of patterns. Behind a question mark in a web address stands what the server is asked."""
LONGEST_NAME = 60
"""Of a copy, without its ending."""
STAMPS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "Last-Modified", "updated", "created")
"""What file systems call it when a file is no longer the same, the surest first."""
MOST_LEVELS = 64
"""Of folders in one another: a server that makes them up, or leads back to the first one, has no end."""
SILENT_S = 60.0
"""How long a web server may send nothing."""
PACKAGES = {"gs": "gcsfs", "gcs": "gcsfs", "abfs": "adlfs", "az": "adlfs"}
"""What file systems need that no extra of fltea has."""
DESCRIBE = (".json", ".yaml", ".yml")
"""Endings of files that lie beside recordings and tell of them, and only where they are named are some."""
JOURNAL = "_journal.ndjson"
"""Of a table of verdicts, which may lie among recordings. Readers of Parquet pass over underscores."""


class File(NamedTuple):
    """One file. path: as its file system calls it. stamp: changes when the file does; empty: nobody knows."""

    url: str
    protocol: str
    path: str
    size: int
    stamp: str

    @property
    def suffix(self) -> str:
        """Its ending in small letters, of letters and digits only: it becomes part of a file's name."""
        found = PurePosixPath(self._name).suffix.lower()
        return found if re.fullmatch(r"\.[a-z0-9]{1,16}", found) else ""

    @property
    def copied_name(self) -> str:
        """That of a copy: its own but for what no name needs. Some loggers tell only by it what they wrote.

        Files of a session would be looked for by theirs, and are copied one by one.
        """
        name = PurePosixPath(self._name).name.removesuffix(PurePosixPath(self._name).suffix)
        is_one = KINDS.get(self.suffix) not in ("mcap", "bag")
        stem = re.sub(r"[^a-zA-Z0-9_.-]+", "_", name)[:LONGEST_NAME].strip("._-") if is_one else ""
        return f"{stem or 'recording'}{self.suffix}"

    @property
    def _name(self) -> str:
        return self.path.partition("?")[0] if self.protocol in WEB else self.path


class Unlisted(NamedTuple):
    """A folder below one that was asked for whose files are not known, and why."""

    folder: File
    reason: str


def file_system(protocol: str) -> Any:
    """What opens files; it keeps no listing, which would be of yesterday and fill the memory.

    Raises:
        UsageError: its package is not installed, or it may not be used here.
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
    """By itself aiohttp gives a file five minutes in all, as long to a silent one, and memory to any."""
    from aiohttp import ClientTimeout

    from fltea.cluster.bounded import BoundedResponse

    timeout = ClientTimeout(total=None, sock_connect=SILENT_S, sock_read=SILENT_S)
    return {"client_kwargs": {"timeout": timeout, "response_class": BoundedResponse}}


def files_of(patterns: Sequence[str]) -> Iterator[File | Unlisted]:
    """The files of paths, URLs, patterns (`**` is any number of folders) and folders, one folder at a time.

    Of a folder all recordings in it and below it are taken, by their endings. Links to folders are not
    followed there, and pipes, sockets and devices are passed over.

    Raises:
        UsageError: nothing there, or a URL that cannot be used.
        FlteaError: the file system refuses.
    """
    for pattern in patterns:
        protocol, path = _split(pattern)
        system = file_system(protocol)
        found = 0
        try:
            for file in _matching(system, protocol, path):
                found += 1
                yield file
        except FileNotFoundError as error:  # fsspec says so of web servers that say nothing, too
            cause = error.__cause__
            if cause is not None and getattr(cause, "status", 0) != 404:
                raise FlteaError(f"{pattern}: cannot be read ({type(cause).__name__}: {cause}).") from error
        except (FlteaError, GeneratorExit):
            raise
        except Exception as error:  # every file system has its own: credentials, names, networks
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
    if magic is None or system.isfile(path):  # a name may hold brackets
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
    """The same for a file however it is named; behind a link `..` is not what stands before."""
    before, parent, after = f"{path}/".rpartition("/../")
    return os.path.normpath(f"{os.path.realpath(before + parent)}/{after}" if parent else path)


def _below(system: Any, protocol: str, folder: str, depth: int | None) -> Iterator[dict[str, Any] | Unlisted]:
    """The files of a folder and of those in it, in the order of their names, but for tables of verdicts.

    depth: of folders, if limited.
    """
    folders = [(folder, 0)]
    seen = set()
    while folders:
        now, level = folders.pop()
        if now in seen:
            continue
        seen.add(now)
        if level > MOST_LEVELS:
            reason = f"lies {MOST_LEVELS} folders deep; does the server make folders up? Name the one below"
            yield Unlisted(File(_url(protocol, now), protocol, now, -1, ""), reason)
            continue
        try:
            inside = sorted(system.ls(now, detail=True), key=lambda one: str(one["name"]))
        except (FileNotFoundError, PermissionError) as error:
            if level == 0:
                raise
            if isinstance(error, PermissionError):  # not gone since the folder that it is in was listed
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
    """Of a link what it leads to, else as it was listed."""
    if not about.get("islink"):
        return about
    try:
        found: dict[str, Any] = system.info(about["name"])
    except OSError:  # it leads nowhere: reported when it is read
        return {**about, "type": "file"}
    return found


def _file(system: Any, protocol: str, about: dict[str, Any]) -> File:
    name = str(about["name"])
    if about.get("size") is None:  # what a web server lists
        about = system.info(name)
    stamp = next((str(about[key]) for key in STAMPS if about.get(key)), "")
    size = about.get("size")
    return File(_url(protocol, name), protocol, name, -1 if size is None else int(size), stamp)


def _url(protocol: str, name: str) -> str:
    url = name if protocol in LIKE_NAMES else f"{protocol}://{name.lstrip('/')}"
    if protocol in WEB and "?" in url:  # it may be a signature, and the table is for everybody
        place, _, query = url.partition("?")
        url = f"{place}?…{hashlib.blake2b(query.encode(), digest_size=4).hexdigest()}"
    return url.encode(errors="replace").decode()  # a name may hold bytes that are no text
