"""Functions for all pictures.

The pictures are PNG files with a palette, and are drawn without opening a window.
"""

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = 128


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of this size [inches], whose layout adapts to its contents."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=85, layout="constrained")


def png(figure: "Figure") -> bytes:
    """Return the picture as a PNG file with a palette.

    Without a palette the file would be four times as large.
    """
    from PIL import Image

    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", metadata={"Software": None})
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(small, format="png", optimize=True)
    return small.getvalue()
