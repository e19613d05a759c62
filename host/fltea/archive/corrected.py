"""Computes the gyroscope's rates minus their biases for a recording, as the daemon does."""

from collections.abc import Iterator

from fltea.records.block import ALL, Block
from fltea.records.ports import Source
from fltea.records.records import Corrected
from fltea.settings.config import Config, LinkConfig
from fltea.settings.duration import Duration
from fltea.settings.outputs import OutputConfig
from fltea.stream.pipeline import Pipeline


def corrected(source: Source, max_gap: Duration) -> Iterator[Corrected]:
    """Yield, for each event of the source, a record with the samples' rates minus the estimated biases."""
    pipeline = Pipeline(source, Config(link=LinkConfig(max_gap=max_gap), output=OutputConfig(corrected=True)))
    for event in source.events():
        for item in pipeline.feed(event):
            if isinstance(item, Block) and item.corrected_dps is not None:
                yield from item.corrected_records(ALL)
