"""What a notebook shows of an axis: the verdict in words, the figures with their intervals, two curves."""

from html import escape

from fltea.api._said import Said
from fltea.api._svg import Curve, log_log
from fltea.records.fit import Interval

UNDEFINED = "undefined"
SMALLEST = 1e-16
"""Of probabilities: what is below is none that anyone can tell."""


def page(body: str) -> str:
    """A frame around it; colours are those of the notebook."""
    return f'<div class="fltea" style="max-width:60em;margin:0.5em 0">{body}</div>'


def axis_html(axis: str, said: Said, heading: str) -> str:
    """One axis; whatever comes from a file is escaped."""
    unit = said.unit
    parameters = [
        ("order α", said.alpha, ""),
        ("parameter f", said.f, "s<sup>−α</sup>"),
        ("F = h<sup>α</sup> f + α", said.F, ""),
        ("variance s2", said.s2, f"({escape(unit)})²"),
        ("white noise R", said.R, f"({escape(unit)})²"),
    ]
    rows = [f"<tr><th>{label}</th><td>{_interval(one)} {of}</td></tr>" for label, one, of in parameters]
    if said.null_p is not None:
        rows.append(f"<tr><th>p of the null test</th><td>{_probability(said.null_p)}</td></tr>")
    if said.allan is not None:
        for name, of in (("N", "/√Hz"), ("B", ""), ("K", "/√s")):
            value = getattr(said.allan, name)
            shown = "not seen" if value is None else f"{value:.3g} {escape(unit)}{of}"
            rows.append(f"<tr><th>{name}</th><td>{shown}</td></tr>")
    return (
        f"<p><strong>{escape(axis)}: {escape(said.verdict)}</strong> <small>{escape(heading)}</small><br>"
        f"{escape(said.text)}</p><table>{''.join(rows)}</table>{_curves(said)}"
    )


def _curves(said: Said) -> str:
    shown = ""
    if (s := said.spectrum) is not None:
        curves = [Curve(s.hz, s.density, "data"), Curve(s.hz, s.model, "model")]
        shown += log_log("Spectrum (orange: fitted)", "frequency [Hz]", f"density [{said.unit}/√Hz]", curves)
    if (a := said.allan) is not None:
        curves = [Curve(a.tau_s, a.adev, "data", a.low, a.high), Curve(a.tau_s, a.model, "model")]
        shown += log_log(
            "Allan deviation, 95 % (orange: fitted)",
            "averaging time τ [s]",
            f"deviation [{said.unit}]",
            curves,
        )
    return shown


def _probability(p: float) -> str:
    return f"{p:.2g}" if p > SMALLEST else f"below {SMALLEST:g}"


def _interval(one: Interval) -> str:
    if one.value is None or one.low is None or one.high is None:
        return UNDEFINED
    return f"{one.value:.3g} <small>({one.low:.3g} … {one.high:.3g})</small>"
