"""Checks that the scripts in `findings/` have the form that findings/README.md describes.

`make lint` runs it.

The program does not check what the scripts find. Usage: findings_form.py [FOLDER]
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("library", "expected", "seen", "matters", "fltea")
"""Names of the sections in the head of a script, in this order."""
SHORTEST_PART = 40
"""Smallest number of characters of a section. What is shorter can hardly be a sentence. The section `library`
may be shorter: it is only a name and a version.
"""
OWN = re.compile(r"import fltea|from fltea|-m fltea|/fltea\b|pip\S* install.*fltea")
INSTALLS = re.compile(r"^\S*pip\S*\" install (.*)$", re.MULTILINE)
PINNED = re.compile(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.]*")
NEEDED = {
    "set -euo pipefail": "stops at the first error",
    "mktemp -d": "makes a temporary folder",
    "trap 'rm -rf \"$folder\"' EXIT": "removes the folder by a trap",
    "-m venv": "makes a virtual environment there",
}
"""Texts that each script must contain, each with its purpose."""
SOURCE = re.compile(r"https?://|section \d|register ", re.IGNORECASE)


def head_of(text: str) -> dict[str, str]:
    """Return the sections of a script's head by name; the head is the comment lines at the script's top."""
    parts: dict[str, str] = {}
    name = ""
    for line in text.splitlines()[1:]:
        if not line.startswith("#"):
            break
        if found := re.match(r"# (\w+): (.*)", line):
            name = found[1]
            parts[name] = found[2]
        elif name:
            parts[name] += " " + line.removeprefix("#").strip()
    return parts


def faults_of(script: Path) -> list[str]:
    """Return in what a script differs from the form that findings/README.md describes."""
    text = script.read_text(encoding="utf-8")
    head = head_of(text)
    body = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    faults = [f"its head lacks '# {part}:'" for part in PARTS if part not in head]
    if not faults and tuple(head) != PARTS:
        faults.append(f"the parts of its head are {', '.join(head)}, and have to be {', '.join(PARTS)}")
    short = [part for part in PARTS[1:] if len(head.get(part, "-" * SHORTEST_PART)) < SHORTEST_PART]
    faults += [f"'# {part}:' is no sentence" for part in short]
    if "expected" in head and not SOURCE.search(head["expected"]):
        faults.append("'# expected:' names no source: an address, or a document's section or register")
    faults += [f"lacks `{words}`, which {why}" for words, why in NEEDED.items() if words not in body]
    installed = [word for line in INSTALLS.findall(body) for word in line.split() if not word.startswith("-")]
    faults += [f"'{word}' has no version: {word}==1.2.3" for word in installed if not PINNED.fullmatch(word)]
    if not installed:
        faults.append("installs no package by pip")
    for package in head.get("library", "").split(", "):
        if package.replace(" ", "==") not in installed:
            faults.append(f"'# library:' names {package}, which is not what is installed")
    if OWN.search(body):
        faults.append("uses fltea: a finding is shown without it")
    if not script.stat().st_mode & 0o100:
        faults.append("cannot be run: chmod +x")
    return faults


def faults(folder: Path) -> list[str]:
    """Return a text for each fault in a folder of findings: in its scripts, and in its table."""
    scripts = sorted(folder.glob("*.sh"))
    found = [f"{script.name}: {fault}" for script in scripts for fault in faults_of(script)]
    rows = re.findall(
        r"^\| \[(\S+)\]\((\S+)\) \|", (folder / "README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    listed, there = [name for name, link in rows if name == link], [script.name for script in scripts]
    if listed != there:
        found.append(
            f"README.md: its table has {', '.join(listed)}; the folder {', '.join(there)}, in this order"
        )
    others = [one.name for one in folder.iterdir() if one.suffix != ".sh" and one.name != "README.md"]
    return found + [f"{name}: is neither a script nor README.md" for name in sorted(others)]


def main() -> None:
    """Print the faults; exit with 1 if there are any."""
    found = faults(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "findings")
    for fault in found:
        print(f"findings/{fault}", file=sys.stderr)
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
