"""Runs a reader process for a file of another program's format, with limits set by the operating system.

A damaged or malicious file may crash a C library or make it loop. In a separate process, the library cannot
harm the program. `process_limits` sets the limits before the process opens the file. The process sends
columns or text through a pipe, in the form that `by_library` describes; what a library prints is discarded.
"""

import contextlib
import fcntl
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import IO, BinaryIO, cast

import msgspec
import numpy as np
from msgspec.structs import replace

from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored, listed
from fltea.recording.formats import FORMATS, Kind
from fltea.recording.kind import is_of_this_process
from fltea.recording.process_limits import ProcessLimits, not_started
from fltea.recording.quota import Quota
from fltea.recording.reader_blocks import FAILED, LENGTH
from fltea.recording.reading import ASK, Answer, Missing, NotStated, asked_with, given_options
from fltea.recording.sample_times import Floats
from fltea.recording.sheet import Sheet, SheetHead, TextHead, open_sheet
from fltea.records.errors import UsageError
from fltea.settings.extras import how_to_install
from fltea.settings.how import How
from fltea.settings.limits import Limits


def open_in_process(kind: Kind, path: Path, how: How, limits: Limits, file: BinaryIO | None = None) -> Stored:
    """Read a file in a format that a reader process has to read.

    `file`: the open content, if the content is not at `path`; then `path` is only used as a name.

    Raises:
        UsageError: the library is not installed, the file is damaged or has another format, its quota is
            exceeded, or `open_sheet` or `open_csv` refuses the content.
    """
    form = FORMATS[kind]
    library = form.library
    if library and (sys.modules.get(library, form) is None or importlib.util.find_spec(library) is None):
        raise UsageError(
            f"{path}: {form.title} files need the package {library}, which is not installed: "
            f"{how_to_install(form.extra)}."
        )
    try:
        opened = path.open("rb") if file is None else contextlib.nullcontext(file)
        quota = Quota(path, limits, None if file is None else os.fstat(file.fileno()).st_size)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from error
    with opened as content:
        # Another process cannot always open the content by its path: /dev/stdin would be that process's own
        # stdin, and archive members have no path. In these cases, the reader process gets the open
        # descriptor.
        is_named = file is None and not is_of_this_process(path)
        place = os.fspath(path) if is_named else f"/dev/fd/{content.fileno()}"
        limits_of_it = ProcessLimits.of(quota)
        with _process(path, [kind, place, how.topic or ""], content, limits_of_it) as (process, sent):
            assert process.stdin is not None
            frames = _frames(path, process, sent, quota, limits_of_it)
            head = msgspec.json.decode(next(frames), type=SheetHead | None)
            if head is None:
                return open_text(path, msgspec.json.decode(next(frames), type=TextHead), frames, how, limits)
            blocks = partial(_columns, process.stdin, frames)
            sheet = Sheet(**{name: getattr(head, name) for name in head.__struct_fields__}, blocks=blocks)
            # in the reader process, the content may have another name than the one that the user gave
            notes = (one._replace(text=one.text.replace(f"{place}: ", f"{path}: ", 1)) for one in sheet.notes)
            sheet = replace(sheet, notes=tuple(notes))
            return open_sheet(path, sheet, how, limits)


def open_text(path: Path, head: TextHead, lines: Iterator[bytes], how: How, limits: Limits) -> Stored:
    """Read the text in one part of a file, such as a sheet.

    Raises:
        NotStated: the file has several parts, and the user has to choose one.
        UsageError: `open_csv` refuses the text.
    """
    inner = replace(how, topic=None) if head.topic else how
    read = partial(open_csv, path, inner, limits, cast(BinaryIO, _Text(lines)), head.head)
    if head.parts:
        which = Missing(f"which sheet is meant of {listed(head.parts)}", "--sensor ?")
        raise asked_with(str(path), which, given_options(how), read)
    found = read()
    reading = (
        (Answer("sensor", head.topic, "given", "--sensor"), *found.reading) if head.topic else found.reading
    )
    return found._replace(topic=head.topic, reading=reading)


@contextlib.contextmanager
def _process(
    path: Path, words: list[str], file: BinaryIO, limits: ProcessLimits
) -> Iterator[tuple["subprocess.Popen[bytes]", BinaryIO]]:
    """Start `by_library.main` with the open file, and yield the process and its output.

    When the caller is done, end the process.
    """
    held = msgspec.json.encode(limits).decode()
    command = [sys.executable, "-B", "-P", "-m", "fltea.recording.by_library", held]
    # Libraries are set to use only one thread: each further thread would reserve memory, and its processor
    # time would count against the limit.
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "ARROW_NUM_THREADS"), "1")
    environment = {
        **os.environ,
        **threads,
        "ARROW_DEFAULT_MEMORY_POOL": "system",
        "PYTHONPATH": os.pathsep.join(_trusted_folders()),
    }
    with contextlib.ExitStack() as ends:
        sent, frames = map(ends.enter_context, _pipe())
        try:
            started = subprocess.Popen(
                [*command, str(frames.fileno()), *words],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=environment,
                pass_fds=(file.fileno(), frames.fileno()),
            )
        except OSError as error:
            raise not_started(path, error) from error
        process = ends.enter_context(started)
        ends.callback(process.kill)
        frames.close()  # closed in this process, so that the output ends when the reader process ends
        yield process, sent


def _pipe() -> tuple[BinaryIO, BinaryIO]:
    """Open a pipe with descriptors above 2, since a child's stdin, stdout and stderr take 0 to 2."""
    ends = os.pipe()
    read, write = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 3) for end in ends)
    for end in ends:
        os.close(end)
    return open(read, "rb"), open(write, "wb")


def _trusted_folders() -> list[str]:
    """Return the folders for imports without the current folder, in which files may come from anyone."""
    here = os.getcwd()
    return [folder for folder in sys.path if os.path.isabs(folder) and folder != here]


def _frames(
    path: Path, process: "subprocess.Popen[bytes]", sent: BinaryIO, quota: Quota, limits: ProcessLimits
) -> Iterator[bytes]:
    """Yield the blocks of bytes that the process sends.

    Raises:
        UsageError: the process failed or crashed.
        FlteaError: the process was killed, or the system refused it memory or another resource.
    """
    while len(head := sent.read(LENGTH.size)) == LENGTH.size:
        (length,) = LENGTH.unpack(head)
        if length == FAILED:
            reason = sent.read().decode(errors="replace")
            raise (NotStated if ASK in reason else UsageError)(f"{path}: {reason}")
        if not length:
            return
        quota.unpack(length)
        yield sent.read(length)
    raise limits.ended(quota, process.wait())


def _columns(stdin: IO[bytes], frames: Iterator[bytes], places: Sequence[int]) -> Iterator[Floats]:
    # a broken pipe means that the process failed; what it sent holds the reason
    with contextlib.suppress(BrokenPipeError):
        stdin.write(msgspec.json.encode(list(places)) + b"\n")
        stdin.flush()
    for data in frames:
        yield np.frombuffer(data, np.float64).reshape(-1, len(places)).copy()


class _Text(contextlib.AbstractContextManager["_Text"]):
    """The text that the reader process sends, as a file object."""

    def __init__(self, frames: Iterator[bytes]) -> None:
        self._frames = frames

    def __exit__(self, *exception: object) -> None:
        pass

    def read1(self, _: int) -> bytes:
        """Return the next block of bytes; b"" at the end."""
        return next(self._frames, b"")
