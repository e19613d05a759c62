"""Recognises ROS bags, and finds the files that belong to a bag."""

import re
from pathlib import Path

from fltea.recording.formats import FORMATS
from fltea.recording.session import SESSION
from fltea.records.errors import UsageError
from fltea.records.small_file import open_file
from fltea.settings.extras import load

(ROS1, SQLITE), MCAP = FORMATS["bag"].magic, b"\x89MCAP0\r\n"
"""First bytes of the three kinds of bags. A file that begins with the bytes of MCAP may also be a recording
of fltea, which is no bag.
"""

SUFFIXES = FORMATS["bag"].suffixes
"""Endings of the names of bags other than MCAP files. A bag of ROS 1 that is being written is named
NAME.bag.active.
"""

OF_FOLDERS = ("*.mcap", "*.db3")
PACKED = ".zstd"

PROFILES = (b"ros1", b"ros2")
ENCODINGS = ("ros1", "cdr", "json", "protobuf")
"""Message encodings of MCAP files that are from ROS or other programs, and not from fltea."""

BEGIN_BYTES = 4096
PROFILE_AT = len(MCAP) + 1 + 8
"""Offset at which an MCAP file stores the length of the name of its profile [bytes]. The profile is the
convention that its messages follow, such as ros2.
"""


def files_of(folder: Path) -> list[Path]:
    """Return the files of a bag that is a folder, in the order of the numbers in their names."""
    plain = {file for pattern in OF_FOLDERS for file in folder.glob(pattern) if file.is_file()}
    packed = [file for pattern in OF_FOLDERS for file in folder.glob(pattern + PACKED)]
    return sorted([*plain, *(file for file in packed if file.with_suffix("") not in plain)], key=_number)


def _number(file: Path) -> tuple[int, str]:
    number = re.search(r"_(\d+)$", file.name.partition(".")[0])
    return (int(number[1]) if number else -1), file.name


def is_bag_folder(folder: Path) -> bool:
    """Return whether a folder is a bag of ROS 2, even if it was not closed and lacks metadata.yaml."""
    try:
        files = files_of(folder)
        if not files or (folder / "metadata.yaml").is_file():
            return bool(files)
        names = {re.sub(r"_\d+$", "", file.name.partition(".")[0]) for file in files}
        return len(names) == 1 and (files[0].suffix != ".mcap" or is_ros_mcap(files[0]))
    except OSError:
        return False


def bags_in(folder: Path) -> list[Path]:
    """Return the bags in a folder; none if the folder is itself a bag.

    If a folder with bags also holds fltea's own MCAP files, the folder itself is added to the bags.
    """
    if not folder.is_dir() or is_bag_folder(folder):
        return []
    bags = [path for path in sorted(folder.iterdir()) if _is_bag(path)]
    ours = bool(bags) and any(path not in bags for path in folder.glob("*.mcap"))
    return [*bags, folder] if ours else bags


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return is_bag_folder(path)
    return path.suffix in SUFFIXES or (path.suffix == ".mcap" and is_ros_mcap(path))


def is_ros_mcap(path: Path) -> bool:
    """Return whether an MCAP file is from ROS and not from fltea.

    The profile that the file states decides. If it states none, the schemas and the encoding of its messages
    decide.
    """
    try:
        with open_file(path) as file:
            begin = file.read(BEGIN_BYTES)
    except OSError:
        return False  # opening the file later reports why it is unreadable
    length = int.from_bytes(begin[PROFILE_AT : PROFILE_AT + 4], "little")
    if begin[PROFILE_AT + 4 : PROFILE_AT + 4 + length] in PROFILES:
        return True
    if SESSION.encode() in begin or not begin.startswith(MCAP):
        return False
    module = load("fltea.recording.scan", "mcap", "ros", "MCAP files need")
    try:
        for item in module.Scan(path):
            if isinstance(item, module.Channel):
                return item.message_encoding in ENCODINGS
            if isinstance(item, module.Schema) and item.name.startswith("fltea."):
                return False
    except (OSError, ValueError, UsageError):
        pass
    return False
