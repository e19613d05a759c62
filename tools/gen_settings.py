"""Writes two files with copies of settings that host/fltea/settings declares.

These files are the board's header file with the filters' parameters, and the TOML file with all defaults,
host/docs/reference/defaults.toml.
"""

import json
from pathlib import Path

from fltea.settings.config import SETTINGS, TABLES
from fltea.settings.setting import Declared, declared

from tools.generated import rendered

SOURCE = "host/fltea/settings"
CPP = "firmware/core/filter_settings.h"
TOML = "host/docs/reference/defaults.toml"


def cpp() -> str:
    """Return the text of the board's header file.

    The file has those settings of `estimator` and `link` that exist on the board, too.
    """
    rows = [
        _constant(one)
        for path, one in SETTINGS.items()
        if one.setting.board and path.partition(".")[0] in ("link", "estimator")
    ]
    return rendered("filter_settings.h", variant=SETTINGS["estimator.variant"].default, constants=rows)


def _constant(one: Declared) -> tuple[str, str, str, str]:
    """Return the meaning, the C++ type, the name and the value of a setting."""
    words = one.path.split(".")[1:]
    name = "k" + "".join(word[0].upper() + word[1:] for part in words for word in part.split("_"))
    match one.default:
        case str():
            kind = "Estimator" + one.name.capitalize()
            value = f"{kind}::{'FLTEA_VARIANT' if one.name == 'variant' else one.default}"
        case int():
            kind, value = "uint16_t", str(one.default)
        case _:
            kind, value = "float", f"{one.default!r}f"
    unit = f" [{one.unit}]" if one.unit else ""
    return one.setting.meaning + unit, kind, name, value


def example() -> str:
    """Return the text of a TOML file with all tables of settings.

    The accelerometer's table has only the settings whose defaults differ from those of the gyroscope.
    """
    text: list[str] = []
    for path, table in TABLES.items():
        rows = [one for one in declared(table, path) if path.partition(".")[0] != "accel" or _differs(one)]
        if rows:
            lines = [_line(one) for one in rows]
            about = " ".join((type(table).__doc__ or "").split("\n\n")[0].split())
            text += [*(["", f"[{path}]  # {about}"] if path else []), *lines]
    return "\n".join(text)


def _differs(one: Declared) -> bool:
    return bool(one.default != SETTINGS["estimator" + one.path.removeprefix("accel")].default)


def _line(one: Declared) -> str:
    shown = one.setting.example if one.default is None else one.default
    pair = f"{'# ' * (one.default is None)}{one.name} = {json.dumps(shown, ensure_ascii=False)}"
    unit = f" [{one.unit}]" if one.unit else ""
    return f"{pair:<27} # {one.setting.meaning}{unit}"


def outputs(root: Path) -> dict[str, str]:
    """Return the paths and texts of the header and the TOML file."""
    return {CPP: cpp(), TOML: f"# Every setting of fltea with its default.\n{example()}\n"}
