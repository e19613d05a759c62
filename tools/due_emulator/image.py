"""Reads a firmware image for the board, and facts about it.

The build of the image has written the facts into a JSON file next to the image.
"""

import hashlib
import json
from pathlib import Path
from typing import NamedTuple

from fltea.records.errors import UsageError

from tools.due_emulator.memory_map import FLASH_BYTES


class Image(NamedTuple):
    """A firmware image with facts about it.

    `ram_bytes`: RAM that the image needs, from the JSON file next to the image; None without such a file.
    `build_id`: taken from the JSON file, otherwise computed from the image's contents.
    """

    path: Path
    content: bytes
    build_id: str
    ram_bytes: int | None

    @property
    def flash_bytes(self) -> int:
        """Size in flash [bytes]."""
        return len(self.content)


def read_image(path: Path) -> Image:
    """Read a raw binary (objcopy -O binary) that begins with the vector table.

    Raises:
        UsageError: the file cannot be read, it is not a firmware image, or the JSON file next to it is not
            valid.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be read ({error.strerror}). Build it with 'make firmware'."
        ) from error
    if content[:4] == b"\x7fELF":
        raise UsageError(f"{path}: is an ELF file; give the .bin file instead (objcopy -O binary).")
    if not 8 <= len(content) <= FLASH_BYTES:
        raise UsageError(f"{path}: has {len(content)} bytes; an image for the Due has 8 to {FLASH_BYTES}.")
    build_id, ram_bytes = hashlib.sha256(content).hexdigest()[:8], None
    beside = path.with_suffix(".json")
    if beside.exists():
        try:
            facts = json.loads(beside.read_text(encoding="utf-8"))
            build_id, ram_bytes = str(facts["build_id"]), int(facts["ram_bytes"])
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise UsageError(f"{beside}: does not describe an image ({error!r}). Build it again.") from error
    return Image(path, content, build_id, ram_bytes)
