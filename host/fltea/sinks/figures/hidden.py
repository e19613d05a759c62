"""The common reasons why a place, such as the live page, does not show a figure."""

from fltea.sinks.figures.figure import Hidden

SETTING = Hidden("it is a setting of the program or of the device, and no measurement")
ESTIMATE = Hidden("the estimate after the newest sample, which every place shows, says it")
FIT = Hidden("the newest fit, which every place shows, says it")
PER_SAMPLE = Hidden("it changes with every sample, so one value in a thousand says nothing")
OF_HOST = Hidden("this computer's figure, which it should equal, is shown")

NO_METRIC = Hidden("it is no metric")
NO_PANEL = Hidden("the dashboard has what explains an answer or a loss; a query of one's own shows the rest")
NO_ROW = Hidden("it explains no answer of the page; a person who needs it has the metric and the record")
NARROW = Hidden("a terminal has few lines: they are for the noise, the bias and the losses")
NO_ENTITY = Hidden("Home Assistant gets the noise, the bias, steps, motion and lost samples of a sensor")

ONLY_METRIC = {
    "page": NO_ROW,
    "terminal": NARROW,
    "home_assistant": NO_ENTITY,
    "grafana": NO_PANEL,
}
"""For a figure that is shown only as a metric: the reasons why no other place shows it."""
