"""Show an axis in a notebook: the verdict in words, the figures with their intervals, and two charts."""

from html import escape

from fltea.api._tables import figures
from fltea.documents import curves
from fltea.records.fit import FittedAxis, Interval
from fltea.records.quantity import Quantity, quantity_of, texts

UNDEFINED = "undefined"
SMALLEST = 1e-16
"""A probability below this is not shown as a number, but as "below" this number."""


def page(body: str) -> str:
    """Return `body` in an HTML frame that keeps the notebook's colours."""
    return f'<div class="fltea" style="max-width:60em;margin:0.5em 0">{body}</div>'


def axis_html(axis: str, fitted: FittedAxis, heading: str, more: str = "") -> str:
    """Return the HTML of one axis; all text that comes from a file is escaped.

    `more`: further sentences that are shown at the end.
    """
    unit = fitted.unit
    parameters = [
        ("order α", fitted.alpha, ""),
        ("parameter f", fitted.f, "s<sup>−α</sup>"),
        ("F = h<sup>α</sup> f + α", fitted.F, ""),
        ("variance s2", fitted.s2, f"({escape(unit)})²"),
        ("white noise R", fitted.R, f"({escape(unit)})²"),
    ]
    rows = [f"<tr><th>{label}</th><td>{_interval(one)} {of}</td></tr>" for label, one, of in parameters]
    if fitted.null_p is not None:
        p = f"{fitted.null_p:.2g}" if fitted.null_p > SMALLEST else f"below {SMALLEST:g}"
        rows.append(f"<tr><th>p of the null test</th><td>{p}</td></tr>")
    if fitted.allan is not None:
        for name, one in zip("NBK", figures(fitted), strict=True):
            rows.append(f"<tr><th>{name}</th><td>{_quantity(one)} {escape(one.unit)}</td></tr>")
    return (
        f"<p><strong>{escape(axis)}: {escape(fitted.verdict)}</strong> <small>{escape(heading)}</small><br>"
        f"{escape(fitted.text)}</p>{more and f'<p>{escape(more)}</p>'}"
        f"<table>{''.join(rows)}</table>{''.join(curves_of(fitted))}"
    )


def curves_of(fitted: FittedAxis) -> list[str]:
    """Return the charts of spectrum and Allan deviation as SVG. A chart that the axis lacks is left out."""
    found = [] if fitted.spectrum is None else [curves.spectrum(fitted.spectrum, fitted.unit)]
    found += [] if fitted.allan is None else [curves.allan(fitted.allan, fitted.unit)]
    return found


def _interval(one: Interval) -> str:
    if one.value is None or one.low is None or one.high is None:
        return UNDEFINED
    return _quantity(quantity_of(one, ""))


def _quantity(one: Quantity) -> str:
    """Return the text of a figure: its value with the interval; the upper bound if the value is not known."""
    value, interval = texts(one)
    return value + (interval and f" <small>{interval}</small>")
