"""Save snapshots of the estimators in a file, so that a restarted program continues where it stopped.

`fltea.stream.snapshot` decides whether a snapshot may be used.
"""

import contextlib
import fcntl
import os
import threading
from collections.abc import Callable
from pathlib import Path

import msgspec

from fltea.records.errors import FlteaError, UsageError
from fltea.records.own_file import open_own
from fltea.records.small_file import read_small
from fltea.records.whole_file import whole_file
from fltea.settings.outputs import StateConfig
from fltea.stream.snapshot import DeviceState

MOST_BYTES = 1 << 30
"""Largest size of the file of snapshots [bytes]. It is enough for many devices, even if their filters keep
every sample.
"""

VERSION = 5
"""Version of the file's format, and of the states of native estimators in the file.

It becomes larger whenever the format changes. A file of another version is not used.
"""

BEGINNING = b'{"version":'
"""First bytes of every file of snapshots, of each version."""

POLL_S = 1.0
"""A new snapshot is in the file after at most this time [s]. The setting `period_s` says how often a snapshot
is made.
"""


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    version: int
    devices: dict[str, DeviceState]


class _Header(msgspec.Struct, frozen=True):
    version: int
    devices: dict[str, msgspec.Raw]


class StateFile:
    """Keeps the latest snapshot of every device, and writes all of them to one file, in a separate thread.

    Raises:
        UsageError: the file cannot be read or written, is not fltea's, or another program uses it.
    """

    def __init__(self, config: StateConfig, report: Callable[[str, str], None]) -> None:
        assert config.file is not None
        self._path = Path(config.file)
        self._period_s = config.period_s
        self._report = report
        _check_writable(self._path)
        self._held = _hold(self._path)
        try:
            self._devices = self._read()
        except UsageError:
            os.close(self._held)
            raise
        self.found = dict(self._devices)
        self._lock = threading.Lock()
        self._changed = self._failed = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="state", daemon=True)
        self._thread.start()

    def _read(self) -> dict[str, DeviceState]:
        path = self._path
        data = _content(path)
        if data is None:
            return {}
        try:
            version = _version(path, data)
        except _Cut as error:
            self._set_aside(f"{path} is empty or damaged ({error}), so the start-up window begins again")
            return {}
        if version != VERSION:
            self._report(
                "state_unused",
                f"{path} is of another version of fltea ({version}): the start-up window begins again, and "
                "the file is replaced.",
            )
            return {}
        try:
            return dict(msgspec.json.decode(data, type=_File).devices)
        except (ValueError, RecursionError) as error:
            self._set_aside(f"{path} is damaged ({error}), so the start-up window begins again")
            return {}

    def refuse(self, name: str) -> None:
        """Rename the file and keep it for inspection, since an estimator has refused a device's snapshot.

        The snapshots of the other devices are written to a new file.
        """
        with self._lock:
            self._devices.pop(name, None)
            self._changed = bool(self._devices)
        self._set_aside(f"the snapshot of {name or 'the device'} in {self._path} was refused")

    def _set_aside(self, why: str) -> None:
        refused = self._path.with_name(self._path.name + ".refused")
        try:
            self._path.replace(refused)
        except FileNotFoundError:  # the file was already renamed because of another device
            return
        except OSError as error:
            self._report("state_failed", f"{why}; the file cannot be kept as {refused} ({error}).")
        else:
            self._report("state_refused", f"{why}; the file is kept as {refused}.")

    def put(self, name: str, state: DeviceState) -> None:
        """Replace a device's snapshot. The new snapshot is written to the file within `POLL_S` seconds."""
        with self._lock:
            self._devices[name] = state
            self._changed = True

    @property
    def has_failed(self) -> bool:
        """Whether the last attempt to write the file has failed."""
        return self._failed

    def close(self) -> None:
        """Write snapshots that are not written yet, and end the thread."""
        self._stop.set()
        self._thread.join()
        self._changed |= self._failed
        self._write()
        os.close(self._held)

    def _run(self) -> None:
        while not self._stop.wait(min(self._period_s, POLL_S)):
            self._write()

    def _write(self) -> None:
        with self._lock:
            if not self._changed:
                return
            self._changed = False
            data = msgspec.json.encode(_File(VERSION, self._devices))
        try:
            with whole_file(self._path) as file:
                file.write(data)
            self._failed = False
        except FlteaError as error:
            if not self._failed:
                self._failed = True
                self._report("state_failed", f"{error} The old one is kept.")


class _Cut(ValueError):
    """A file of snapshots is empty, cut off, or full of zeros."""


def check_file(path: Path) -> None:
    """Check that a file can be used for snapshots. The file is not changed.

    Raises:
        UsageError: the file cannot be read or written, or is not fltea's.
    """
    _check_writable(path)
    data = _content(path)
    with contextlib.suppress(_Cut):  # the file will be set aside
        if data is not None:
            _version(path, data)


def _content(path: Path) -> bytes | None:
    """Return what a file of snapshots holds; None if there is no such file."""
    try:
        return read_small(path, what="--state", most_bytes=MOST_BYTES)
    except UsageError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            return None
        raise


def _version(path: Path, data: bytes) -> int:
    """Return the version of a file of snapshots that holds `data`.

    Raises:
        UsageError: the file is not fltea's.
        _Cut: the file is fltea's, but is empty or cut off.
    """
    try:
        return msgspec.json.decode(data, type=_Header).version
    except (ValueError, RecursionError) as error:
        if _is_cut(data, error):
            raise _Cut(str(error)) from error
        text = f"--state {path}: is no snapshot of fltea ({error}). Give another name, or remove it."
        raise UsageError(text) from error


def _is_cut(data: bytes, error: Exception) -> bool:
    """Return whether a file that cannot be decoded is what a power cut or a full disk leaves of a snapshot.

    Such a file is empty, holds zeros only, or begins like a snapshot and is no JSON. `error`: why it cannot
    be decoded.
    """
    left = data.rstrip(b"\0")
    is_json = isinstance(error, msgspec.ValidationError)
    return not is_json and (BEGINNING.startswith(left) or left.startswith(BEGINNING))


def _check_writable(path: Path) -> None:
    folder = path.parent
    if (
        path.is_symlink()
    ):  # each saving would replace the link by a file, and leave the link's target as it is
        raise UsageError(f"--state {path}: is a link, and has to be a file. Name the file to which it leads.")
    if not folder.is_dir():
        raise UsageError(f"--state {path}: there is no folder {folder}.")
    if (path.exists() and not path.is_file()) or not os.access(folder, os.W_OK):
        raise UsageError(
            f"--state {path}: cannot be written there. It has to be a file in a folder of yours."
        )


def _hold(path: Path) -> int:
    """Lock `.FILE.lock`, so that no second program uses the file; return the lock file's descriptor.

    The lock file contains the ID of this process. The state file itself cannot be locked, since each saving
    replaces it by a new file.
    """
    lock = path.with_name(f".{path.name}.lock")
    try:
        held = open_own(lock, 0o644)
    except (OSError, ValueError) as error:  # ValueError is raised for a name that holds a NUL
        raise UsageError(f"--state {path}: {lock} cannot be made ({error}).") from error
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        who = os.read(held, 20).decode("ascii", "replace").strip()
        os.close(held)
        raise UsageError(
            f"--state {path}: another fltea (process {who}) keeps its snapshots there. Give each one file."
        ) from None
    except OSError as error:
        os.close(held)
        raise FlteaError(
            f"--state {path}: its lock {lock} cannot be taken ({error}). On a file system without locks "
            "a second fltea would overwrite the snapshots unseen: keep them on a disk of this machine."
        ) from error
    os.truncate(held, 0)
    os.write(held, b"%d\n" % os.getpid())
    return held
