"""Run fltea command lines one after the other in one process, to measure its memory.

stdin: a JSON list of command lines. stdout: a JSON object with the exit code and the stderr text of each
command, and with the largest resident size [MB] before the first and after the last command.
"""

import contextlib
import io
import json
import resource
import sys
import traceback

from fltea.cli.app import main


def resident_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(command: list[str]) -> tuple[int | str, str]:
    sys.argv = ["fltea", *command]
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main()
        except SystemExit as end:
            return end.code or 0, said.getvalue()
        except BaseException:
            return "traceback", said.getvalue() + traceback.format_exc()
    return 0, said.getvalue()


if __name__ == "__main__":
    import fltea.archive.export
    import fltea.archive.info
    import fltea.identification.run
    import fltea.recording.recovery
    import fltea.service.daemon  # noqa: F401  (all modules are loaded before memory is first measured)

    commands = json.load(sys.stdin)
    before = resident_mb()
    results = [run(command) for command in commands]
    json.dump({"results": results, "before_mb": before, "after_mb": resident_mb()}, sys.stdout)
