"""Reads titles of three columns, such as `Gyro X,Y,Z (deg/s)`, as three names of columns."""

import re
from collections.abc import Sequence

_TITLE = re.compile(
    r"(?P<before>.*?)(?P<open>\(?)(?<!\w)(?P<axes>[xyzXYZ]\s*(?P<mark>[,/])\s*[xyzXYZ]\s*(?P=mark)\s*[xyzXYZ])"
    r"(?P<close>\)?)"
    r"(?P<unit>\s*[\[(][^\[\]()]*(?:\([^()]*\))?[^\[\]()]*[\])])?"
)
"""Matches a title of three axes in any order, with the unit of all three after it."""

LONGEST_TITLE = 100


def without_titles(names: Sequence[str]) -> list[str]:
    """Return the names of columns, with three names in place of each title of three axes.

    Where commas separate the names, a title has already become three names: `Gyro X`, `Y`, `Z (deg/s)`.
    """
    found: list[str] = []
    k = 0
    while k < len(names):
        may_be = names[k][-1:] in tuple("xyzXYZ") or "," in names[k] or "/" in names[k]
        for count in (1, 3) if may_be else ():
            axes = _axes(",".join(names[k : k + count]))
            if axes:
                found += axes
                break
        else:
            found.append(names[k])
            count = 1
        k += count
    return found


def _axes(title: str) -> list[str]:
    found = _TITLE.fullmatch(title) if len(title) <= LONGEST_TITLE else None
    if found is None or bool(found["open"]) != bool(found["close"]):
        return []
    axes = [letter for letter in found["axes"].upper() if letter in "XYZ"]
    if sorted(axes) != ["X", "Y", "Z"]:
        return []
    before, unit = found["before"].strip(), (found["unit"] or "").strip()
    if not (before or unit) or (found["mark"] == "," and not unit):
        return []
    return [" ".join(filter(None, (before, axis, unit))) for axis in axes]
