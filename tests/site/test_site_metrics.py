"""The reference of metrics names, for each metric, its field and the other outputs that show the field."""

from fltea.sinks.figures.table import FIGURES

from tools import site_hooks


def test_each_metric_has_its_field_and_the_places_that_show_it() -> None:
    rows = [line.strip("| ").split(" | ") for line in site_hooks.metrics().splitlines()[2:]]
    found = {row[0].strip("`"): row for row in rows}
    named = {figure.metric_name for figure in FIGURES if figure.metric_name}
    assert named <= found.keys()
    assert found["fltea_samples_lost_total"][4:] == [
        "`stats.sample_counts.lost`",
        "page, terminal, Home Assistant, Grafana",
    ]
    assert found["fltea_axis_steps_total"][4].strip("`") == "stats.axes.<axis>.tracker.steps"
    without = {name for name in found.keys() - named if name.startswith("fltea_")}
    assert without == {
        "fltea_build_info",
        "fltea_device_info",
        "fltea_errors_total",
        "fltea_motions_total",
        "fltea_output_latency_seconds",
    }
