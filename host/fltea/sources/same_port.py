"""Refuse two sources that would read from the same port or sensor.

The second source could not open the port, or each of the two would get a part of the data.
"""

from collections.abc import Sequence

from fltea.records.errors import UsageError
from fltea.settings.config import Config
from fltea.settings.sources import BY_SCHEME
from fltea.sources.open_source import module_of, named
from fltea.sources.opening import Named


def check_apart(configs: Sequence[Config]) -> None:
    """Check that no two sources read from the same port of this machine, standard input or sensor.

    Raises:
        UsageError: two sources do, perhaps by different names of the port.
    """
    found: dict[str, str] = {}
    for config in configs if len(configs) > 1 else ():
        source = config.source or ""
        place = _place(source)
        if place in found:
            raise UsageError(
                f"--source {source}: that is {place}, which --source {found[place]} reads already. Only one "
                "source can read from it: name it once."
            )
        if place:
            found[place] = source


def _place(source: str) -> str:
    """Return what a source alone can read from; "" if there is no such thing, as for recordings."""
    found = named(source) if source else Named("", "")
    kind = BY_SCHEME.get(found.scheme)
    return "" if kind is None or kind.shared else module_of(kind, found.scheme).only_reader_of(found)
