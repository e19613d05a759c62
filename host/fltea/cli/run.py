"""The command `fltea run`: it makes a configuration from flags and starts the daemon."""

from typing import Any

from fltea.cli.setting_flags import ConfigFile, Sources, takes_settings
from fltea.settings.config import load_configs


@takes_settings()
def run(
    settings: dict[str, Any],
    source: Sources = None,
    config: ConfigFile = None,
) -> None:
    """Watch a sensor live, or replay a recording: the noise of each axis and its bias, sample by sample.

    The command draws a live table on a terminal, or writes one JSON object per line
    (host/docs/reference/records.md): verdict, order α and parameter f with intervals, bias and state with σ,
    and the heading error to expect. If a device is missing or falls silent, the program reports that and
    waits for the device.

    For example:

        fltea run

        fltea run -s replay:rest.npz --once --format table

        fltea run --corrected | my-navigation

        fltea run -s rest.csv --columns gx,gy,gz --units rad/s --rate 100

        my-imu | fltea run -s stdin: --columns gx,gy,gz --units dps --time-column t_ms --once

        fltea run -s replay:rest.npz --once --shuffle 1

        fltea run --estimate-on both

        fltea run --dashboard 5006 --record recordings --mqtt mqtts://broker.example --format none

        fltea run -s serial:/dev/ttyACM0 -s 'i2c:///dev/i2c-1?addr=0x68' --channels gyro_z,accel_x
    """
    from fltea.service import daemon

    daemon.run(load_configs(config, settings, source or ()))
