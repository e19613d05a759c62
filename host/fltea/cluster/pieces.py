"""Cuts a large file of any format into pieces; a worker reads each piece like a recording.

Some files cannot be cut and are read whole: .npz, .db3, compressed files, NDJSON, and incomplete files.
"""

import contextlib
from pathlib import Path

from fltea.cluster import cut_mcap, cuts
from fltea.cluster.content import open_bytes
from fltea.cluster.cut import Cut, Ranges
from fltea.cluster.fetch import COPY_BYTES, check_room
from fltea.cluster.listing import WEB, File
from fltea.cluster.whole import Ask
from fltea.recording.formats import KINDS
from fltea.recording.kind import kind_of
from fltea.records.errors import FlteaError
from fltea.records.temporary import named_file


def cuts_of(file: File, ask: Ask) -> list[Cut]:
    """Return the pieces of a file; an empty list if it has to be read whole.

    Raises:
        FlteaError: the file changed since it was listed.
        OSError: the file is not readable now; its file system may raise other errors.
    """
    if file.size <= ask.block_bytes or (file.protocol in WEB and not file.stamp):
        return []  # without an entity tag or date, the server may take two pieces from different contents
    with open_bytes(file) as stream:
        source = Ranges(file, stream)
        if file.protocol in WEB and not source.are_there():
            return []
        found: list[Cut] = []
        match kind_of(source.read(0, 16)) or KINDS.get(file.suffix):
            case "npy":
                found = cuts.of_npy(source, ask.block_bytes)
            case "csv":
                found = cuts.of_text(source, ask.block_bytes, ask.how)
            case "mcap":
                found = cut_mcap.cuts(source, ask.block_bytes)
            case "bag":
                found = cuts.of_bag(source, ask.block_bytes)
            case "parquet":
                # Without pyarrow, the file is read whole, so that the missing package is reported.
                with contextlib.suppress(ModuleNotFoundError):
                    from fltea.cluster import cut_parquet

                    found = cut_parquet.cuts(source, ask.block_bytes)
    return found if len(found) > 1 else []


def write_piece(file: File, cut: Cut, folder: Path) -> Path:
    """Write a piece as a recording in `folder`, and return its path.

    Raises:
        FlteaError: the file changed, or the disk is full.
        OSError: the file system failed; it may raise other errors.
    """
    if KINDS.get(file.suffix) == "parquet":
        from fltea.cluster.cut_parquet import write_groups

        return write_groups(file, cut, folder)
    check_room(file, cut.end - cut.begin, folder)
    path = folder / file.copied_name
    with open_bytes(file) as source, named_file(path) as out:
        out.write(cut.head)
        source.seek(cut.begin)
        left = cut.end - cut.begin
        while left:
            data = source.read(min(left, COPY_BYTES))
            if not data:
                raise FlteaError(f"{file.url}: lacks {left} bytes that it had when it was listed.")
            out.write(data)
            left -= len(data)
        out.write(cut.tail)
    return path
