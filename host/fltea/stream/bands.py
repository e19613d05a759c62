"""The stage that says what white noise would give in place of each axis (fltea.estimator.white_band)."""

from collections import Counter
from collections.abc import Callable, Iterator

from fltea.records.block import Block
from fltea.records.events import Event, Ints
from fltea.records.records import ACCEL_AXES, AXES, Hello
from fltea.settings.config import Config, EstimatorConfig
from fltea.stream.stages import Beginning, Item, Saved, Standing
from fltea.stream.white import AxisBand, Sensor
from fltea.wire.sample_scaling import accel_resolution_ms2, resolution_dps


class WhiteBands:
    """Lets the runs of each axis keep in step with its estimates.

    settings: gives those with which the gyroscope's axes are estimated as of now, None while that is not
    known. valid: whether the board's newest estimate of an axis is valid, None while there is none; given
    where the board alone estimates, whose estimates are not in the blocks.
    """

    def __init__(
        self,
        config: Config,
        settings: Callable[[], EstimatorConfig | None],
        valid: Callable[[str], bool | None] | None = None,
    ) -> None:
        self._config, self._settings, self._valid = config, settings, valid
        self._hello: Hello | None = None
        self._gyro: dict[str, AxisBand] = {}
        self._accel: dict[str, AxisBand] = {}
        self._gyro_axes: list[str] = []
        self._waiting: Counter[str] = Counter()

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch."""
        wanted = self._config.channels
        self._hello = beginning.hello
        self._gyro, self._accel = {}, {}
        self._waiting.clear()
        available = AXES[: beginning.gyro_axes] if self._config.bands_of_gyro else ()
        self._gyro_axes = [axis for axis in available if wanted is None or axis in wanted]
        if beginning.accel and self._config.bands_of_accel:
            axes = [axis for axis in ACCEL_AXES if axis in (wanted or ())]
            resolution = accel_resolution_ms2(beginning.hello)
            self._accel = _bands(axes, self._config.accel, beginning.hello, resolution, len(AXES))

    def bridge(self, count: int) -> None:
        """The runs begin with the epoch, whatever it goes on from."""

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Follow samples and their estimates."""
        settings, hello = self._settings(), self._hello
        if not self._gyro and self._gyro_axes and settings is not None and hello is not None:
            self._gyro = _bands(self._gyro_axes, settings, hello, resolution_dps(hello), 0)
        after = {
            axis: band.on_samples(block.gyro_dps[:, AXES.index(axis)]) for axis, band in self._gyro.items()
        }
        if block.accel_ms2 is not None:
            for axis, band in self._accel.items():
                band.on_samples(block.accel_ms2[:, ACCEL_AXES.index(axis)])
        bands = self._gyro | self._accel
        for columns in block.estimates:
            for place, axis in enumerate(columns.axes):
                if axis in bands:
                    bands[axis].on_estimates(columns.valid[:, place])
        if self._valid is not None:
            for axis, samples in after.items():
                self._follow_board(axis, samples, self._valid(axis))
        yield block

    def on_event(self, event: Event) -> Iterator[Item]:
        """Nothing else matters here."""
        return iter(())

    def forget(self) -> None:
        """The next epoch begins with new runs anyway."""

    def standing(self) -> Standing:
        """What white noise would give, of each axis for which that is known."""
        bands = self._gyro | self._accel
        return Standing(white={axis: known for axis, band in bands.items() if (known := band.stats())})

    def save(self) -> Saved | None:
        """Nothing is kept: the runs are to be as young as what they are compared with."""
        return None

    def _follow_board(self, axis: str, samples: int, valid: bool | None) -> None:
        """Follow an axis by the board's newest estimate; until there is one the samples wait for its word."""
        if valid is None:
            self._waiting[axis] += samples
        else:
            self._gyro[axis].on_count(samples + self._waiting.pop(axis, 0), valid=valid)


def _bands(
    axes: list[str], config: EstimatorConfig, hello: Hello, resolution: float | None, first_seed: int
) -> dict[str, AxisBand]:
    """The axes of a sensor; R, where it is a list, has one entry for each of them."""
    sensor = Sensor(config, 1 / hello.rate_hz, resolution)
    R = config.R if isinstance(config.R, list) else [config.R] * len(axes)
    return {
        axis: AxisBand(sensor, None if isinstance(own, str) else own, first_seed + number)
        for number, (axis, own) in enumerate(zip(axes, R, strict=True))
    }
