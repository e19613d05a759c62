"""Where faults of a cluster are played: a scheduler that can be killed, and a worker."""

import asyncio
import subprocess
import sys
import threading
from typing import Any

SCHEDULER = """
import asyncio
from distributed import Scheduler

async def main():
    async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
        print(scheduler.address, flush=True)
        await scheduler.finished()

asyncio.run(main())
"""


class Cluster:
    """A Dask scheduler in a process of its own, and a worker with one thread in this one."""

    def __init__(self) -> None:
        self.scheduler = subprocess.Popen(
            [sys.executable, "-c", SCHEDULER], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert self.scheduler.stdout is not None
        self.address = self.scheduler.stdout.readline().strip()
        self._worker = threading.Thread(target=asyncio.run, args=(self._work(),))
        self._worker.start()

    async def _work(self) -> None:
        from distributed import Worker

        worker: Any = Worker  # it has no types
        async with worker(self.address, nthreads=1, dashboard=False) as one:
            await one.finished()  # ends with its scheduler

    def kill(self) -> None:
        """The scheduler, by `kill -9`."""
        self.scheduler.kill()
        self.scheduler.wait()

    def close(self) -> None:
        """End both."""
        self.kill()
        assert self.scheduler.stdout is not None
        self.scheduler.stdout.close()
        self._worker.join()
