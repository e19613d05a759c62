"""Tests of identifying many recordings: results are in order, and failures do not affect other recordings.

Nothing is lost or counted twice if a worker dies.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.identification.axis import NOT_RUN
from fltea.identification.axis_report import AxisReport, Failure, FileReport
from fltea.identification.findings import document
from fltea.identification.load import Request, Unreadable, load
from fltea.identification.run import identify_all
from fltea.identification.settings import Settings
from fltea.identification.workers import SMALL, Here, Processes, Threads, open_local
from fltea.records.errors import FlteaError, UsageError
from fltea.records.records import ACCEL_AXES
from fltea.settings.estimator import EstimatorConfig

from tests.rig.cluster_support import two_workers
from tests.rig.host_support import wait_until
from tests.rig.identify_files import Deadly, counts, npz, settings
from tests.rig.identify_support import long_recursion

N = 600
PATIENCE_S = 60.0


def files(folder: Path, count: int) -> list[Request]:
    """Write recordings of accelerometers with one, two and three axes."""
    found = []
    for i in range(count):
        path = npz(folder / f"{i}.npz", counts(N, 1), accel_raw=counts(N, 3, seed=i), accel_lsb_per_g=16384.0)
        found.append(Request((path,), ACCEL_AXES[: 1 + i % 3]))
    return found


def axes(reports: list[FileReport]) -> list[list[str]]:
    return [list(report.axes) for report in reports]


def deadly(request: Request, mark: Path, times: int) -> Request:
    return Request((Deadly(request.paths[0], mark, times),), request.channels)


Known = tuple[list[Request], list[dict[str, Any]]]


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Known:
    """Return recordings of one, two and three axes, and the results that this process alone finds."""
    requests = files(tmp_path_factory.mktemp("known"), 3)
    return requests, document(identify_all(requests, settings(), Here()))["files"]


def test_order_and_failures(known: Known, tmp_path: Path) -> None:
    """Bad files do not change the results of the other files.

    One of the bad files is missing, one is no recording, and one has a constant axis.
    """
    dead = counts(N, 1)
    dead[:] = 7
    extra = {"accel_raw": counts(N, 3), "accel_lsb_per_g": 16384.0}
    good, alone = known
    requests = [
        good[1],
        Unreadable("x.mcap", UsageError("x.mcap: is none.")),
        Request((npz(tmp_path / "dead.npz", dead, **extra),), ("gyro_x", "accel_x")),
        Request((tmp_path / "away.npz",)),
        good[0],
    ]
    seen: list[tuple[str, int, int]] = []
    reports = identify_all(requests, settings(), Here(), progress=lambda *now: seen.append(now))
    assert [Path(report.name).name for report in reports] == [
        "1.npz", "x.mcap", "dead.npz", "away.npz", "0.npz",
    ]  # fmt: skip
    assert axes(reports) == [["accel_x", "accel_y"], [], ["gyro_x", "accel_x"], [], ["accel_x"]]
    assert [report.failure is None for report in reports] == [True, False, True, False, True]
    assert "no such file" in str(reports[3].failure)
    constant, other = reports[2].axes.values()
    assert isinstance(constant, Failure)
    assert "constant" in constant.error
    assert isinstance(other, AxisReport)
    found = document(reports)["files"]
    assert (found[0], found[4]) == (alone[1], alone[0])
    assert [done for _, done, _ in seen] == list(range(1, len(seen) + 1))
    assert seen[-1][1] == seen[-1][2]
    assert all(done <= total for _, done, total in seen)


def test_the_number_of_processes_does_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Results do not depend on which process does which task, nor on the order in which tasks end."""
    raw = np.rint(16 * long_recursion(0.6, -0.19, N, 1)).astype(np.int32)[:, np.newaxis]
    requests = [Request((npz(tmp_path / "a.npz", raw, accel_raw=counts(N, 3), accel_lsb_per_g=16384.0),))]
    lanes = 8
    monkeypatch.setattr("fltea.identification.shuffled.MOST_LANES", lanes)
    many = settings(shuffles=2 * lanes + 1)
    alone = document(identify_all(requests, many, Here()))
    assert alone["files"][0]["axes"]["gyro_x"]["null"]["shuffled"]["copies"] == 2 * lanes + 1
    for made in (Processes, Threads):
        with closing(made(2)) as workers:
            assert document(identify_all(requests, many, workers)) == alone
    monkeypatch.setattr("fltea.identification.hand_out.CHECK_S", 0.001)
    assert document(identify_all(requests, many, LastFirst())) == alone


OF_DETAILS: dict[str, object] = {
    "fltea": None,
    "fltea_other": None,
    "fltea_reason": NOT_RUN,
    "innovations": {},
    "reproduction": None,
}


def test_what_is_not_asked_for_is_not_found_out_and_changes_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = np.rint(16 * long_recursion(0.6, -0.19, N, 1)).astype(np.int32)[:, np.newaxis]
    requests = [Request((npz(tmp_path / "a.npz", raw),))]
    ((_, whole),) = document(identify_all(requests, settings(), Here()))["files"][0]["axes"].items()
    assert whole["fltea"]["variant"] == "joint"
    assert whole["reproduction"]["text"]
    for module, name in (("one_axis", "fltea_fits"), ("one_axis", "reproduction"), ("run", "estimate")):
        monkeypatch.setattr(f"fltea.identification.{module}.{name}", None)
    brief = msgspec.structs.replace(settings(shuffles=20), details=False)
    ((_, found),) = document(identify_all(requests, brief, Here()))["files"][0]["axes"].items()
    assert found == whole | OF_DETAILS | {"null": whole["null"] | {"shuffled": None}}


def test_why_nothing_can_be_compared_is_said_whatever_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*of_axis: object) -> None:
        raise ValueError("the axis is constant: there is nothing to compare with")

    monkeypatch.setattr("fltea.identification.one_axis.check_comparable", refuse)
    requests = [Request((npz(tmp_path / "a.npz", counts(N, 1)),))]
    for details in (True, False):
        (report,) = identify_all(requests, msgspec.structs.replace(settings(), details=details), Here())
        (found,) = report.axes.values()
        assert isinstance(found, AxisReport)
        assert found.allan_reason == "the axis is constant: there is nothing to compare with"


def test_settings_that_no_filter_can_work_with_are_told_whatever_is_asked_for(tmp_path: Path) -> None:
    requests = [Request((npz(tmp_path / "a.npz", counts(N, 1)),))]
    joint = msgspec.structs.replace(EstimatorConfig().joint, alpha0=5.0)
    for details in (True, False):
        gyro = EstimatorConfig(startup=100, joint=joint)
        wrong = msgspec.structs.replace(settings(), gyro=gyro, details=details)
        (report,) = identify_all(requests, wrong, Here())
        (found,) = report.axes.values()
        assert isinstance(found, Failure)
        assert "joint.alpha0 must be within the bounds of the guard" in found.error


class LastFirst(Here):
    """A stand-in for worker processes. It runs its tasks only when a caller waits for them, the last task
    first.
    """

    slots = 100

    def __init__(self) -> None:
        self._given: list[tuple[Any, ...]] = []

    def submit(self, task: Any, *arguments: Any) -> Any:
        future: Future[Any] = Future()
        if task is load:
            return super().submit(task, *arguments)
        self._given.append((future, task, arguments))
        return future

    def check(self) -> None:
        future, task, arguments = self._given.pop()
        future.set_result(task(*arguments))


def test_samples_are_not_kept(tmp_path: Path) -> None:
    (report,) = identify_all(files(tmp_path, 1), settings(), Here())
    assert not report.recording.axes


def test_numbers_of_an_axis() -> None:
    listed = Settings(settings().options, EstimatorConfig(bias=[0.1, 0.2, 0.3], R=[1.0, 2.0, 3.0]))
    channels = ("gyro_x", "accel_y", "gyro_z")
    found = listed.of_axis("gyro_z", channels).estimator
    # gyro_z gets the second number of each list, since it is the second axis of the gyroscope here
    assert (found.bias, found.R) == (0.2, 2.0)
    assert listed.of_axis("accel_y", channels).estimator.bias == "startup"
    short = Settings(settings().options, EstimatorConfig(bias=[0.1]))
    with pytest.raises(UsageError, match="bias: has 1 numbers, but gyro_z is axis 2"):
        short.of_axis("gyro_z", channels)


def test_a_process_that_dies_costs_nothing(known: Known, tmp_path: Path) -> None:
    """A worker process dies once, at one of the recordings.

    All recordings have the same result as if this process did all the work.
    """
    requests, alone = known
    mark = tmp_path / "mark"
    ill = [requests[0], deadly(requests[1], mark, 1), requests[2]]
    with closing(Processes(2)) as workers:
        assert document(identify_all(ill, settings(), workers))["files"] == alone
    assert len(mark.read_text()) == 2


@pytest.mark.slow
def test_what_kills_its_process_is_told_from_the_others(known: Known, tmp_path: Path) -> None:
    requests, alone = known
    mark = tmp_path / "mark"
    ill = [deadly(requests[0], mark, 99), requests[1]]
    with closing(Processes(2)) as workers:
        bad, good = document(identify_all(ill, settings(), workers))["files"]
    assert "killed" in bad["error"]
    assert bad["axes"] == {}
    assert good == alone[1]
    assert len(mark.read_text()) == 2


def test_closing_ends_what_is_under_way() -> None:
    workers = Processes(2)
    busy = [workers.submit(time.sleep, 100 * PATIENCE_S) for _ in range(2)]
    deadline = time.monotonic() + PATIENCE_S
    while not all(one.running() for one in busy) and time.monotonic() < deadline:
        time.sleep(0.01)
    pids = list(workers._pool._processes)
    assert len(pids) == 2
    workers.close()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_ctrl_c_while_the_processes_load() -> None:
    """Worker processes ignore the signal of Ctrl-C from the start, also while they load modules, and print no
    traceback.
    """
    script = """
from multiprocessing import forkserver
from fltea.identification.workers import Processes
workers = Processes(1)
print(open(f"/proc/{forkserver._forkserver._forkserver_pid}/status").read())
workers.close()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    ignored = next(line for line in done.stdout.splitlines() if line.startswith("SigIgn:"))
    assert int(ignored.split()[1], 16) >> (signal.SIGINT - 1) & 1


INTERRUPTED = """
import os, signal, sys
from multiprocessing import forkserver
from fltea.cli.identify import _interrupt_once
from fltea.identification.workers import Processes
number = int(sys.argv[1])
signal.signal(number, _interrupt_once)
workers, begun, read = Processes(1), [], forkserver.read_signed
def read_and_stop(descriptor):
    forkserver.read_signed = read
    begun.append(read(descriptor))
    os.kill(os.getpid(), number)
    return begun[-1]
forkserver.read_signed = read_and_stop
try:
    workers.submit(os.getpid)
except SystemExit as ended:
    workers.close()
    print(ended.code, len(begun), [pid for pid in begun if os.path.exists(f"/proc/{pid}")])
"""
"""A program that gets a signal while it starts a worker process. It prints its exit code, the number of
worker processes that were started, and those that still run.
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_process_starts_leaves_none(number: signal.Signals) -> None:
    """A worker process that was left would find the queues of its parent gone, and print a traceback."""
    command = [sys.executable, "-c", INTERRUPTED, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{128 + number} 1 []\n", "")


def test_one_job_needs_no_process() -> None:
    assert isinstance(open_local(1), Here)
    with closing(open_local(3)) as workers:
        assert workers.slots == 4
    assert isinstance(open_local(1, recordings=1), Here)


@pytest.mark.parametrize(("samples", "here"), [(SMALL, True), (SMALL + 1, False)])
def test_one_recording_is_identified_here_if_it_is_small(samples: int, here: bool) -> None:
    with closing(open_local(3, recordings=1)) as workers:
        workers.expect(samples)
        assert workers.slots == 4
        assert (workers.submit(os.getpid).result() == os.getpid()) is here


def test_workers_that_are_gone_are_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone(Here):
        def submit(self, task: Any, *arguments: Any) -> Any:
            return Future()

        def check(self) -> None:
            raise FlteaError("gone")

    monkeypatch.setattr("fltea.identification.hand_out.CHECK_S", 0.01)
    with pytest.raises(FlteaError, match="gone"):
        identify_all(files(tmp_path, 1), settings(), Gone())


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Start two worker processes for `identify`."""
    with two_workers() as found:
        yield found


@pytest.mark.slow
def test_dask_with_a_worker_killed(known: Known, cluster: Any) -> None:
    """One of two workers is killed when the first axis is done.

    Every axis has one result, the same as from this process alone.
    """
    from fltea.identification.dask_workers import DaskWorkers

    requests, alone = known
    told: list[str] = []
    killed: list[int] = []
    with closing(DaskWorkers(cluster.scheduler_address)) as workers:
        pids = list(workers._client.run(os.getpid).values())
        assert len(set(pids)) == 2

        def kill_one(text: str, done: int, total: int) -> None:
            told.append(text)
            if "accel" in text and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        reports = identify_all(requests, settings(), workers, Here(), kill_one)
    assert killed
    assert document(reports)["files"] == alone
    # Numbers of tasks: one for each file, each axis, the events of each sensor, each group of shuffled
    # copies, the bias of each axis, and FLTEA for each file.
    assert len(told) == len(set(told)) == 3 + 6 + 3 + 6 + 6 + 3


@pytest.mark.slow
def test_a_second_ctrl_c_does_not_tear_down_what_ends(tmp_path: Path) -> None:
    """After a second Ctrl-C, no thread is in native code when the interpreter ends, which would crash."""
    path = npz(tmp_path / "a.npz", counts(1_500_000))
    command = [sys.executable, "-m", "fltea", "identify", path, "--json", "--shuffles", "400"]
    for second_s in (0.05, 0.2, 0.4):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
            folder = Path("/proc", str(running.pid), "task")
            wait_until(lambda folder=folder: len(list(folder.iterdir())) > 2, "its threads")
            running.send_signal(signal.SIGINT)
            time.sleep(second_s)
            running.send_signal(signal.SIGINT)
            _, said = running.communicate(timeout=PATIENCE_S)
        assert (running.returncode, said) == (130, b"")
