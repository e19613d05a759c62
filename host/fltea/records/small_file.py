"""Open a user's files without waiting forever, and read small files, such as settings, as a whole."""

import contextlib
import errno
import os
import select
import stat
import threading
from concurrent.futures import Future
from pathlib import Path
from typing import BinaryIO

from fltea.records.errors import UsageError

MOST_BYTES = 4_000_000
PATIENCE_S = 5.0
"""Longest time to wait for a pipe [s]. Without a limit, the program would wait forever if no other program
opens the pipe for writing.
"""


def read_small(path: Path, *, what: str = "", most_bytes: int = MOST_BYTES, private: bool = False) -> bytes:
    """Return the content of a file, or of a pipe up to its end.

    `what`: the setting that names the file, for messages. Messages quote nothing from the file.
    `private`: the file holds a secret, so it is refused if everybody may read it.

    Raises:
        UsageError: the file cannot be read, is larger than `most_bytes`, or is private and readable by all.
    """
    name = f"{what} {path}".lstrip()
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            about = os.fstat(descriptor)
            if stat.S_ISDIR(about.st_mode):
                raise UsageError(f"{name}: is a folder, and has to be a file.")
            if private and about.st_mode & stat.S_IRWXO:
                raise UsageError(f"{name}: everybody on this machine may read it. Do: chmod o= {path}")
            if not stat.S_ISREG(about.st_mode):
                most_bytes = min(most_bytes, MOST_BYTES)
            data = bytearray()
            while max(len(data), about.st_size) <= most_bytes:
                chunk = _some(descriptor, name)
                if not chunk:
                    return bytes(data)
                data += chunk
            raise UsageError(
                f"{name}: has more than {most_bytes} bytes, so it is not the expected kind of file."
            )
        finally:
            os.close(descriptor)
    except (OSError, ValueError) as error:  # ValueError is raised for a name that holds a NUL
        raise UsageError(f"{name}: cannot be read ({getattr(error, 'strerror', None) or error}).") from error


def _some(descriptor: int, name: str) -> bytes:
    ready = select.poll()
    ready.register(descriptor, select.POLLIN)
    if not ready.poll(PATIENCE_S * 1e3):
        raise UsageError(f"{name}: nothing came out of this pipe for {PATIENCE_S:g} s.")
    return os.read(descriptor, 1 << 16)


def open_file(path: Path) -> BinaryIO:
    """Open a regular file to read. Pipes are refused, since opening one would wait for its writer.

    Raises:
        OSError: the file cannot be opened, or is a pipe or a device.
    """
    file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK))  # noqa: SIM115
    if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        return file
    file.close()
    raise OSError(errno.ESPIPE, "is a pipe or a device, and has to be a file")


def open_stream(path: Path) -> BinaryIO:
    """Open a pipe or a device to read. Once it is open, the program that writes to it may take any time.

    Raises:
        OSError: the pipe cannot be opened.
        UsageError: no program opens the pipe for writing within `PATIENCE_S`.
    """
    opened: Future[BinaryIO] = Future()

    def wait() -> None:
        try:
            opened.set_result(path.open("rb"))
        except OSError as error:
            opened.set_exception(error)

    threading.Thread(target=wait, name=f"open {path}", daemon=True).start()
    try:
        return opened.result(PATIENCE_S)
    except TimeoutError:
        opened.add_done_callback(lambda late: late.exception() or late.result().close())
        # the thread `wait` still waits for a writer: open the pipe for writing, so that the thread ends
        with contextlib.suppress(OSError):
            os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        raise UsageError(
            f"{path}: no program has opened this pipe to write to it within {PATIENCE_S:g} s. First start "
            "the program that writes."
        ) from None
