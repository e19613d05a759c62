"""The common reasons why a place, such as the live page, does not show a figure."""

from fltea.sinks.figures.figure import Hidden

SETTING = Hidden("the number is a setting of the program or of the device, not a measurement")
ESTIMATE = Hidden("every place shows the estimate after the newest sample, which has the same number")
FIT = Hidden("every place shows the newest fit, which has the same number")
PER_SAMPLE = Hidden("the number changes with every sample, so one value in a thousand says nothing")
OF_HOST = Hidden("this computer's own figure is shown, and the device's figure should equal it")

NO_METRIC = Hidden("it is no metric")
NO_PANEL = Hidden("the dashboard shows only what explains an answer or a loss; users can query the rest")
NO_ROW = Hidden("the number explains no answer of the page; the metric and the record have it")
NARROW = Hidden("a terminal has only a few lines, which are needed for the noise, the bias and the losses")
NO_ENTITY = Hidden("Home Assistant gets only what host/docs/guide/outputs.md names; the record has the rest")

ONLY_METRIC = {
    "page": NO_ROW,
    "terminal": NARROW,
    "home_assistant": NO_ENTITY,
    "grafana": NO_PANEL,
}
"""For a figure that is shown only as a metric: the reasons why no other place shows it."""
