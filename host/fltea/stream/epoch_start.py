"""Begin an epoch of a device: with a start-up window, or with the snapshot of an earlier run."""

from collections.abc import Callable

from fltea.records.errors import UsageError
from fltea.records.records import EpochReason
from fltea.settings.config import Config
from fltea.settings.ingest import is_partitioned
from fltea.stream.board import BoardEstimates
from fltea.stream.decode import Decoder, FirstSample
from fltea.stream.epoch import Beginning, Item, Notice
from fltea.stream.sensors import Sensors
from fltea.stream.snapshot import DeviceState, missing_by_number, missing_since, why_unused


class EpochStart:
    """Lets all estimators of a device begin an epoch.

    `board`: the estimates of a board; None if the board does not estimate.
    `state`: the snapshot of an earlier run, until the first epoch has used or refused it; then None.
    `refuse`: a function that is called if the content of that snapshot is not valid.
    `boot_id`: the boot of the present epoch; None before the first epoch.
    """

    def __init__(
        self,
        config: Config,
        decoder: Decoder,
        sensors: Sensors,
        board: BoardEstimates | None,
        state: DeviceState | None,
        refuse: Callable[[], None],
    ) -> None:
        self._config, self._decoder, self._sensors, self._board = config, decoder, sensors, board
        self.state, self._refuse = state, refuse
        self.boot_id: int | None = None
        self._no_axis_reported = False

    def begin(
        self, beginning: Beginning, first: FirstSample, now_ns: int, now_unix_ns: int
    ) -> tuple[list[Item], EpochReason, float | None, int]:
        """Begin an epoch, from the snapshot if there is a suitable one.

        `now_ns`: present time on the source's monotonic clock [ns]. `now_unix_ns`: the same in Unix time.

        Returns:
            the reports to publish,
            the reason why the epoch begins,
            the age of the snapshot [s]; None if no snapshot is used,
            how many samples were lost while the device moved from another process of a cluster to this one,
            since nothing else counts them; otherwise 0.
        """
        notices: list[Item] = []
        hello = beginning.hello
        self.boot_id = hello.boot_id
        absent = beginning.absent(self._config.channels)
        if absent and not self._no_axis_reported:
            self._no_axis_reported = True
            text = (
                f"the setting 'channels' asks for {', '.join(absent)}, which this source does not have, or "
                "for which it states no scale."
            )
            notices.append(Notice("no_axis", text, now_ns))
        state, self.state = self.state, None
        if state is not None:
            problem = why_unused(state, hello, self._config, now_unix_ns)
            if problem is None:
                try:
                    self._begin_sensors(beginning._replace(saved=state))
                except ValueError as error:
                    problem = str(error)
                    self._refuse()
                else:
                    age_s = (now_unix_ns - state.unix_ns) * 1e-9
                    place = first.sequence, first.device_us
                    self._sensors.bridge(missing_since(state, hello, *place, age_s))
                    handed_over = is_partitioned(self._config.source)
                    lost = missing_by_number(state, hello, *place, age_s) if handed_over else None
                    return notices, "resumed", age_s, lost or 0
            text = f"the snapshot is not used: {problem}. The start-up window begins anew."
            notices.append(Notice("state_unused", text, now_ns))
        try:
            self._begin_sensors(beginning)
        except ValueError as error:
            raise UsageError(f"estimator: {error}.") from error
        return notices, first.reason, None, 0

    def _begin_sensors(self, beginning: Beginning) -> None:
        sensors = self._sensors.begin(beginning)
        if self._board is not None:
            self._board.begin(beginning)
        self._decoder.begin(sensors)
