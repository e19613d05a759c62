"""Make the retained configuration with which Home Assistant finds a device by MQTT discovery.

Home Assistant's manual, "MQTT discovery", device discovery: `<prefix>/device/<object_id>/config` names the
device and all its sensors, each with a topic and a template that extracts its value from the payload.
"""

import re

from fltea.records.records import Hello
from fltea.records.stats import AxisStats
from fltea.records.version import __version__
from fltea.sinks.figures.figure import OF_AXIS, ROOTS, Entity, Figure, is_optional
from fltea.sinks.figures.table import FIGURES


def discovery_topic(prefix: str, level: str) -> str:
    """Return the discovery topic of the device whose own topics contain the name `level`.

    Home Assistant accepts only letters, digits, _ and -. Any other character is replaced by its number in
    Unicode, so that different names have different topics.
    """
    return f"{prefix}/device/{_object_id(level)}/config"


def discovery(topics: str, level: str, hello: Hello, axes: dict[str, AxisStats]) -> dict[str, object]:
    """Return the message by which Home Assistant finds a device and all its figures.

    `level`: name of the device in topics. `topics`: the beginning of all its topics, `<mqtt.prefix>/<level>`.
    `axes`: the axes of the device, by name.
    """
    device = {
        "identifiers": [_object_id(level)],
        "name": f"Gyroscope {level}",
        "manufacturer": "fltea",
        "model": hello.sensor or hello.source,
    }
    if hello.device_id:
        device["serial_number"] = hello.device_id
    if hello.firmware_version:
        device["sw_version"] = hello.firmware_version
    entities = [(figure, figure.home_assistant) for figure in FIGURES]
    components = {}
    for figure, entity in entities:
        if isinstance(entity, Entity) and not _is_by_axis(figure, entity):
            components[entity.key] = _component(topics, figure, entity)
    for axis, stats in axes.items():
        for figure, entity in entities:
            if isinstance(entity, Entity) and _is_by_axis(figure, entity):
                component = _component(topics, figure, entity, axis, stats.unit)
                components[f"{axis}_{entity.key}"] = component
    for key, component in components.items():
        component["unique_id"] = f"{_object_id(level)}_{key}"
    return {
        "device": device,
        "origin": {"name": "fltea", "sw_version": __version__},
        "availability_topic": f"{topics}/status",
        "availability_template": "{{ 'online' if value_json.status == 'online' else 'offline' }}",
        "components": components,
    }


def _is_by_axis(figure: Figure, entity: Entity) -> bool:
    """Return whether each axis has an entity of its own for the figure.

    Otherwise the device has one entity for the figure. This is so for a figure that has no value for each
    axis. It is also so if the declaration has its own template (the expression by which Home Assistant
    computes the value), since such a template reads the values of all axes.
    """
    return ROOTS[figure.kind].by_axis and not entity.template


def _component(
    topics: str, figure: Figure, entity: Entity, axis: str = "", unit_of_axis: str = ""
) -> dict[str, str]:
    """Return the configuration of one entity, of the device or of `axis`."""
    root = ROOTS[figure.kind]
    topic = f"{topics}/{root.record.__struct_config__.tag}"
    base = ".".join(part for part in ("value_json", root.path, axis) if part)
    component = {
        "platform": entity.platform,
        "name": f"{axis} {entity.title}".lstrip(),
        "state_topic": topic,
        "value_template": entity.template or _template(base, figure),
    }
    unit = unit_of_axis if entity.unit == OF_AXIS else entity.unit
    options = {
        "unit_of_measurement": unit,
        "state_class": entity.state_class,
        "entity_category": entity.category,
        "device_class": entity.device_class,
    }
    component |= {key: value for key, value in options.items() if value is not None}
    parent, _, leaf = figure.field.rpartition(".")
    # the figure is the value of a parameter with an interval, and the ends of the interval become attributes
    if leaf == "value":
        component["json_attributes_topic"] = topic
        component["json_attributes_template"] = f"{{{{ {base}.{parent} | tojson }}}}"
    return component


def _template(base: str, figure: Figure) -> str:
    """Return Home Assistant's expression that extracts a figure's value from the record.

    The expression gives "None" if the part of the record that contains the figure is absent.
    """
    parent, _, leaf = figure.field.rpartition(".")
    if not parent or not is_optional(figure.kind, parent):
        return f"{{{{ {base}.{figure.field} }}}}"
    return f"{{% set {parent} = {base}.{parent} %}}{{{{ {parent}.{leaf} if {parent} else None }}}}"


def _object_id(level: str) -> str:
    return "fltea_" + re.sub(r"[^A-Za-z0-9-]", lambda one: f"_{ord(one[0]):x}_", level)
