"""Draw spectrum and Allan deviation of an axis, without any drawing library."""

import os
from pathlib import Path

from fltea.api._html import curves_of, page
from fltea.documents.chart import HEIGHT, WIDTH
from fltea.records.fit import FittedAxis
from fltea.records.whole_file import whole_file


class Drawing:
    """Spectrum and Allan deviation side by side, each with the fitted model. A notebook shows the drawing."""

    def __init__(self, of: FittedAxis) -> None:
        self._charts = curves_of(of)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the drawing to an SVG file, which browsers and drawing programs open.

        The file is written completely or not at all.

        Raises:
            ValueError: the name does not end in .svg.
            FlteaError: the file cannot be written.
        """
        if Path(path).suffix.lower() != ".svg":
            raise ValueError(f"the drawing is an SVG file: give a name that ends in .svg, got {str(path)!r}")
        with whole_file(Path(path)) as file:
            file.write(self._repr_svg_().encode())

    def _repr_svg_(self) -> str:
        placed = "".join(
            one.replace("<svg ", f'<svg x="{i * WIDTH}" ', 1) for i, one in enumerate(self._charts)
        )
        width = WIDTH * len(self._charts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{HEIGHT}" '
            f'viewBox="0 0 {width} {HEIGHT}" font-family="sans-serif">'
            f'<rect width="100%" height="100%" fill="#fff"/>{placed}</svg>'
        )

    def _repr_html_(self) -> str:
        return page("".join(self._charts))
