"""Tests with a Dask scheduler that hangs. Its connection stays open, so only a time limit reveals it."""

from contextlib import closing

import pytest
from fltea.records.errors import FlteaError

from tests.rig.host_support import PATIENCE_S
from tests.rig.toolchain import missing
from tools.faults.cluster import Cluster


@pytest.mark.slow
def test_a_scheduler_that_stands_still_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        from fltea.identification import dask_workers
    except ModuleNotFoundError:
        missing("distributed is not installed: pip install -e '.[dask]'")
    monkeypatch.setattr(dask_workers, "CONNECT_S", PATIENCE_S)
    with closing(Cluster()) as cluster:
        workers = dask_workers.DaskWorkers(cluster.address)
        assert workers.slots == 2
        cluster.pause()
        monkeypatch.setattr(dask_workers, "SILENT_S", 0.3)
        with pytest.raises(FlteaError, match="the scheduler is gone, or does not answer"):
            workers.check()
        cluster.kill()
        workers.close()
