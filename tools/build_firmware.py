"""Builds the bare-metal images for the Due with Debian's gcc-arm-none-eabi.

There are two images: in the mode `timer` the board's clock sets the times of samples, in the mode
`data_ready` the sensor's. Writes firmware/due/image/fltea_due.bin and fltea_due.json, which are committed,
for the mode `timer`. Also writes both modes with JSON, ELF, map and stack use to build/firmware/. Run `python
-m tools.generated build_id` first: the image contains the id of the sources.

`--to FILE.bin --mode data_ready --define FLTEA_RATE_HZ=500` writes one image with other settings instead.
`--check` writes nothing to the repository: it builds again and compares. Exit codes: 0: the sources give the
committed image. 1: they give another image. 2: the build failed. 3: there is no compiler. 4: the compiler's
version is not the one that built the image.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.build_id import build_id, version

PREFIX = "arm-none-eabi-"
IMAGE = "firmware/due/image/fltea_due.bin"
RECORD = "firmware/due/image/fltea_due.json"
COMMITTED_MODE = "timer"
MODES = (COMMITTED_MODE, "data_ready")

FLAGS = [
    *("-mcpu=cortex-m3", "-mthumb", "-std=gnu++11", "-Os", "-g", "-ffreestanding"),
    *("-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics", "-fno-unwind-tables"),
    *("-fno-asynchronous-unwind-tables", "-ffunction-sections", "-fdata-sections", "-fstack-usage"),
    # memcpy and memset in runtime.cpp are loops. The compiler must not replace these loops by calls of memcpy
    # and memset, because the functions would then call themselves.
    "-fno-tree-loop-distribute-patterns",
    *("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror"),
]
LINK_FLAGS = ["-nostdlib", "-Wl,--gc-sections", "-Wl,--no-warn-rwx-segments", "-Wl,--fatal-warnings"]

OK, DIFFERS, FAILED, NO_COMPILER, OTHER_COMPILER = range(5)


class BuildError(Exception):
    """Raised when the compiler or linker fails. Its text is the output."""


@dataclass(frozen=True)
class Image:
    """A built image. `ram_bytes` includes the reserved stack."""

    mode: str
    data: bytes
    ram_bytes: int


def compiler() -> str | None:
    """Return the compiler's name and version as it prints them; None if there is no compiler."""
    if not shutil.which(f"{PREFIX}g++"):
        return None
    return _run([f"{PREFIX}g++", "--version"], Path.cwd()).splitlines()[0]


def build(root: Path, mode: str, folder: Path, defines: Sequence[str] = ()) -> Image:
    """Build one firmware image, with all intermediate files in `folder`. A failure raises BuildError.

    `defines`: macros of firmware/core/settings.h, such as FLTEA_RATE_HZ=200.

    The compiler runs inside firmware/ and sees relative paths only, so that the bytes do not depend on where
    the repository is.
    """
    firmware = root / "firmware"
    folder.mkdir(parents=True, exist_ok=True)
    objects = []
    for source in sorted([*firmware.glob("core/*.cpp"), *firmware.glob("due/*.cpp")]):
        name = source.relative_to(firmware).as_posix()
        target = (folder / name.replace("/", "_")).with_suffix(".o").resolve()
        mapped = [f"-ffile-prefix-map={firmware.resolve()}=firmware", f"-DFLTEA_SAMPLING_MODE={mode}"]
        mapped += [f"-D{define}" for define in defines]
        _run([f"{PREFIX}g++", *FLAGS, *mapped, "-c", "-o", str(target), name], firmware)
        objects.append(str(target))
    elf = (folder / "fltea_due.elf").resolve()
    script = [f"-Wl,-Map={elf.with_suffix('.map')}", "-T", "due/sam3x8e.ld"]
    _run([f"{PREFIX}g++", *FLAGS, *LINK_FLAGS, *script, "-o", str(elf), *objects, "-lgcc"], firmware)
    binary = elf.with_suffix(".bin")
    _run([f"{PREFIX}objcopy", "-O", "binary", str(elf), str(binary)], firmware)
    _, data, bss, *_ = _run([f"{PREFIX}size", str(elf)], firmware).splitlines()[1].split()
    image = Image(mode, binary.read_bytes(), int(data) + int(bss))
    made_by = compiler()
    assert made_by is not None, "it has just compiled"
    (folder / Path(RECORD).name).write_text(record(root, image, made_by), encoding="utf-8")
    return image


def record(root: Path, image: Image, made_by: str) -> str:
    """Return the contents of fltea_due.json for an image."""
    return json.dumps(describe(root, image, made_by), indent=2) + "\n"


def describe(root: Path, image: Image, made_by: str) -> dict[str, str | int]:
    """Return the fields of fltea_due.json."""
    return {
        "version": version(root),
        "build_id": build_id(root),
        "sampling_mode": image.mode,
        "sha256": hashlib.sha256(image.data).hexdigest(),
        "flash_bytes": len(image.data),
        "ram_bytes": image.ram_bytes,
        "compiler": made_by,
    }


def check(root: Path, build_folder: Path) -> int:
    """Compare the committed image with the sources; print what differs and return the exit code."""
    if not (root / IMAGE).exists() or not (root / RECORD).exists():
        return _say(DIFFERS, f"{IMAGE} or {RECORD} is missing: run `make firmware`")
    committed = (root / IMAGE).read_bytes()
    recorded = json.loads((root / RECORD).read_text(encoding="utf-8"))
    if recorded["sha256"] != hashlib.sha256(committed).hexdigest():
        return _say(
            DIFFERS, f"{RECORD} describes another image than the present {IMAGE}: run `make firmware`"
        )
    if recorded["build_id"] != build_id(root):
        return _say(
            DIFFERS,
            f"{IMAGE} was built from sources with the id {recorded['build_id']}, "
            f"the present sources have {build_id(root)}: run `make firmware`",
        )
    made_by = compiler()
    if made_by is None:
        return _say(NO_COMPILER, f"{IMAGE} not compared: {PREFIX}g++ is missing (Debian: gcc-arm-none-eabi)")
    if made_by != recorded["compiler"]:
        return _say(
            OTHER_COMPILER,
            f"{IMAGE} not compared: it was built by {recorded['compiler']}, "
            f"and the compiler here is {made_by}",
        )
    image = build(root, COMMITTED_MODE, build_folder / COMMITTED_MODE)
    fresh = describe(root, image, made_by)
    differing = [
        f"{key}: {recorded[key]}, now {value}" for key, value in fresh.items() if recorded[key] != value
    ]
    if image.data != committed:
        pairs = enumerate(zip(image.data, committed, strict=False))
        first = next((i for i, (a, b) in pairs if a != b), min(len(image.data), len(committed)))
        differing.append(f"first differing byte at 0x{0x80000 + first:08X}")
    if differing:
        return _say(DIFFERS, f"{IMAGE} differs from the image that the sources give: {'; '.join(differing)}")
    return OK


def _say(code: int, text: str) -> int:
    print(text, file=sys.stderr)
    return code


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the committed image")
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).resolve().parent.parent, help="repository"
    )
    parser.add_argument(
        "--to",
        type=Path,
        metavar="FILE.bin",
        help="write one image with other settings there, and its facts next to it (FILE.json)",
    )
    parser.add_argument(
        "--mode", choices=MODES, default=COMMITTED_MODE, help="sampling mode of the image that --to writes"
    )
    parser.add_argument(
        "--define",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="with --to: e.g. FLTEA_RATE_HZ=200",
    )
    arguments = parser.parse_args()
    root: Path = arguments.root
    folder = root / "build/firmware"
    try:
        if arguments.check:
            return check(root, folder)
        made_by = compiler()
        if made_by is None:
            return _say(
                NO_COMPILER, f"no {PREFIX}g++ here: install gcc-arm-none-eabi, or use the committed {IMAGE}"
            )
        if arguments.to is not None:
            image = build(root, arguments.mode, folder / "other", arguments.define)
            arguments.to.write_bytes(image.data)
            arguments.to.with_suffix(".json").write_text(record(root, image, made_by), encoding="utf-8")
            return _say(OK, f"{arguments.to}: {', '.join([arguments.mode, *arguments.define])}")
        images = {mode: build(root, mode, folder / mode) for mode in MODES}
    except BuildError as error:
        return _say(FAILED, str(error))
    (root / IMAGE).parent.mkdir(parents=True, exist_ok=True)
    (root / IMAGE).write_bytes(images[COMMITTED_MODE].data)
    (root / RECORD).write_text(record(root, images[COMMITTED_MODE], made_by), encoding="utf-8")
    for mode, image in images.items():
        print(f"{mode}: {len(image.data)} bytes of flash, {image.ram_bytes} of RAM with the stack")
    return OK


if __name__ == "__main__":
    sys.exit(main())
