"""Tests of a command's process: side effects of libraries that it uses, and what remains after its end."""

import os
import subprocess
import sys


def test_no_library_begins_threads_of_its_own() -> None:
    code = """
import os, sys
from fltea.cli.app import main
sys.argv = ["fltea", "--version"]
try:
    main()
finally:
    import numpy as np
    print(np.ones((400, 400)).dot(np.ones((400, 400))).shape, len(os.listdir("/proc/self/task")))
"""
    environment = {name: text for name, text in os.environ.items() if "NUM_THREADS" not in name}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.stdout.splitlines()[-1] == "(400, 400) 1"


def test_the_module_leaks_nothing() -> None:
    code = """
import fltea.spectrum.live_axes as live, fltea.settings.live as of, numpy as np
axes = live.LiveAxes(("x",), 0.01, of.LiveConfig(), "deg/s")
axes.add(np.random.default_rng(1).normal(size=(2000, 1)))
print(axes.fit(curves=True)["x"].verdict)
"""
    command = [sys.executable, "-X", "dev", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("white\n", "")
