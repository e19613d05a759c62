"""Options that say how a recording is to be read: the same for every command, declared with the settings."""

from typing import Annotated

from fltea.cli.setting_flags import option
from fltea.settings.how import TimeUnit

Columns = Annotated[str | None, option("replay.columns")]
Units = Annotated[str | None, option("replay.units")]
Rate = Annotated[float | None, option("replay.rate_hz")]
TimeColumn = Annotated[str | None, option("replay.time_column")]
TimeUnitOption = Annotated[TimeUnit | None, option("replay.time_unit")]
Topic = Annotated[str | None, option("replay.topic")]
