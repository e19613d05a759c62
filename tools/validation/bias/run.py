"""Measure how good fltea's bias, its headings and the figures in its files are.

The bias is compared with the bias that other methods (peers) estimate.

Each section has a name: `--only headings` runs one section, `--only 'errors: ramp'` one noise of a section.
"""

from types import ModuleType

from tools.validation.bias import errors, false_alarms, file_filter, headings, motion, steps
from tools.validation.bias.peers import need_peers
from tools.validation.live_way import AXES
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SEEDS, QUICK_SEEDS = 24, 6
"""Number of simulated axes of each kind. It is rounded up to whole sensors of AXES axes."""
SECTIONS: dict[str, ModuleType] = {
    module.SECTION: module for module in (steps, errors, false_alarms, motion, headings, file_filter)
}


def tasks(options: Options) -> list[Task]:
    """Return the tasks of all sections.

    Raises: UsageError: a peer (a program that is compared with) is not installed; says what installs it.
    """
    need_peers()
    whole = options._replace(seeds=-(-options.seeds // AXES) * AXES)
    return [task for section in SECTIONS.values() for task in section.tasks(whole)]


def tables(rows: list[Row]) -> list[Table | str]:
    """Return the tables of all sections that were run."""
    return [
        table
        for section, those in grouped(rows, lambda row: str(row["section"])).items()
        for table in SECTIONS[section].tables(those)
    ]
