"""Writes the Debian package's copyright file: the licence of fltea, and that of every library in the package.

Usage: deb_copyright.py LICENSE FOLDER WHERE (FOLDER: the folder of the libraries; WHERE: the path of that
folder after installation)
"""

import sys
from importlib.metadata import Distribution, distributions
from pathlib import Path


def licence(library: Distribution) -> str:
    """Return the short name of the licence in a library's metadata. If there is none, the program exits."""
    metadata = library.metadata
    classifiers = [line for line in metadata.get_all("Classifier") or () if line.startswith("License ::")]
    named = [line.rpartition(" :: ")[2] for line in classifiers]
    expressions = metadata.get_all("License-Expression") or [", ".join(named)]
    whole = metadata.get_all("License") or [""]
    said: str = expressions[0] or whole[0].strip().split("\n")[0]
    if not said:
        raise SystemExit(f"{metadata['Name']} does not say its licence")
    return said


def texts(library: Distribution) -> list[str]:
    """Return the paths of the library's licence files, relative to the folder of libraries."""
    words = ("LICEN", "COPYING", "NOTICE")
    names = [str(path) for path in library.files or () if ".dist-info" in str(path)]
    return sorted(name for name in names if any(word in name.rpartition("/")[2].upper() for word in words))


def main(ours: Path, folder: Path, where: str) -> str:
    """Return the text of the copyright file."""
    parts = [
        "fltea",
        "",
        ours.read_text("utf-8").strip(),
        "",
        "",
        f"Libraries in {where}, from the Python Package Index, unchanged but for tests and examples:",
    ]
    for library in sorted(distributions(path=[str(folder)]), key=lambda one: one.metadata["Name"].lower()):
        name = library.metadata["Name"]
        if name == "fltea":
            continue
        parts += ["", f"{name} {library.version}: {licence(library)}"]
        parts += [f"    https://pypi.org/project/{name}/{library.version}/"]
        parts += [f"    {where}/{text}" for text in texts(library)]
    parts += [
        "",
        "On Debian systems the text of the Apache License 2.0 is in /usr/share/common-licenses/Apache-2.0.",
    ]
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]), end="")
