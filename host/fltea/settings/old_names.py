"""Names that settings had once: each is refused with the name that took its place."""

from collections.abc import Mapping
from typing import Any

from fltea.records.errors import UsageError

_PRINTED = (
    "The numpy reference is no part of `fltea run` any more: for the printed algorithm {settings} "
    "(the native engine, equal to the reference up to rounding); `fltea reproduce` runs the reference itself"
)

OLD_WHITE_BAND = (
    "leave it out: the records `fit` say every second whether the noise is white, and else what it is "
    "(host/README.md, [live])"
)


def old_engine(value: object, flag: bool, table: str = "estimator") -> str:
    """What to write in place of `engine = value`. flag: as flags of the command line, else as settings."""

    def written(*pairs: tuple[str, str]) -> str:
        if flag:
            return " ".join(f"--{name.replace('_', '-')} {word}" for name, word in pairs)
        return ", ".join(f'{table}.{name} = "{word}"' for name, word in pairs)

    match value:
        case "compressed" | "direct":
            return f"write {written(('memory', value))}"
        case "device" | "both":
            return f"write {written(('estimate_on', value))}"
        case "reference":
            printed = written(("memory", "direct"), ("variant", "triple"), ("guard", "off"))
            return _PRINTED.format(settings=f"write {printed}")
    who, how = written(("estimate_on", "host|device|both")), written(("memory", "compressed|direct"))
    return f"write {who} for who estimates, or {how} for how"


def refuse_old_names(tree: Mapping[str, Any], origin: str) -> None:
    """Look for old names in the settings, those of single devices included.

    Raises:
        UsageError: there is one; names it, and the new one for its value.
    """
    for table in ("estimator", "accel"):
        settings = tree.get(table)
        if not isinstance(settings, Mapping):
            continue
        if "engine" in settings:
            remedy = old_engine(settings["engine"], False, table)
            raise UsageError(f"{origin}: {table}.engine: there is no such setting any more; {remedy}.")
        if "white_band" in settings:
            raise UsageError(
                f"{origin}: {table}.white_band: there is no such setting any more; {OLD_WHITE_BAND}."
            )
    for name, settings in _tables(tree.get("device")):
        refuse_old_names(settings, f"{origin}: device.{name}")


def _tables(devices: Any) -> list[tuple[str, Mapping[str, Any]]]:
    if not isinstance(devices, Mapping):
        return []
    return [(name, table) for name, table in devices.items() if isinstance(table, Mapping)]
