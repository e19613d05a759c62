"""Make the retained configuration with which Home Assistant finds a device by MQTT discovery.

Home Assistant's manual, "MQTT discovery", device discovery: `<prefix>/device/<object_id>/config` names the
device and all its sensors, each with a topic and a template that extracts its value from the payload.
"""

import re
from typing import Final

from fltea.records.records import Hello
from fltea.records.stats import AxisStats
from fltea.records.version import __version__

_AXIS: Final = "value_json.axes.%s"
_MOVES: Final = """{% set moved = namespace(now=false) %}{% for axis in value_json.axes.values() %}\
{% if axis.tracker and axis.tracker.moving %}{% set moved.now = true %}{% endif %}{% endfor %}\
{{ 'ON' if moved.now else 'OFF' }}"""
_BIAS: Final = "{%% set tracker = value_json.axes.%s.tracker %%}{{ tracker.%s if tracker else None }}"


def discovery_topic(prefix: str, level: str) -> str:
    """Return the discovery topic of the device whose own topics have the level `level`.

    Home Assistant accepts only letters, digits, _ and -. Any other character is replaced by its number, so
    that different names have different topics.
    """
    return f"{prefix}/device/{_object_id(level)}/config"


def discovery(topics: str, level: str, hello: Hello, axes: dict[str, AxisStats]) -> dict[str, object]:
    """Return the configuration of a device.

    `topics`: the beginning of all its topics, `<mqtt.prefix>/<level>`. `axes`: its axes, by name.
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
    components = {"lost": _sensor("samples lost", f"{topics}/stats", "{{ value_json.sample_counts.lost }}")}
    components["lost"] |= {"state_class": "total_increasing", "entity_category": "diagnostic"}
    moves = _sensor("moves", f"{topics}/stats", _MOVES)
    components["moves"] = moves | {"platform": "binary_sensor", "device_class": "motion"}
    for axis, stats in axes.items():
        fit, one = f"{topics}/fit", _AXIS % axis
        components[f"{axis}_noise"] = _sensor(f"{axis} noise", fit, f"{{{{ {one}.verdict }}}}")
        for name, title, unit in (("alpha", "α", None), ("f", "f", "s^-α")):
            sensor = _sensor(f"{axis} {title}", fit, f"{{{{ {one}.{name}.value }}}}", unit)
            sensor |= {
                "state_class": "measurement",
                "json_attributes_topic": fit,
                "json_attributes_template": f"{{{{ {one}.{name} | tojson }}}}",
            }
            components[f"{axis}_{name}"] = sensor
        for name, title in (("bias", "bias"), ("bias_std", "bias σ")):
            sensor = _sensor(f"{axis} {title}", f"{topics}/stats", _BIAS % (axis, name), stats.unit)
            components[f"{axis}_{name}"] = sensor | {"state_class": "measurement"}
        steps = _sensor(f"{axis} steps of the bias", f"{topics}/stats", _BIAS % (axis, "steps"))
        components[f"{axis}_steps"] = steps | {"state_class": "total_increasing"}
    for key, component in components.items():
        component["unique_id"] = f"{_object_id(level)}_{key}"
    return {
        "device": device,
        "origin": {"name": "fltea", "sw_version": __version__},
        "availability_topic": f"{topics}/status",
        "availability_template": "{{ 'online' if value_json.status == 'online' else 'offline' }}",
        "components": components,
    }


def _sensor(name: str, topic: str, template: str, unit: str | None = None) -> dict[str, str]:
    sensor = {"platform": "sensor", "name": name, "state_topic": topic, "value_template": template}
    return sensor if unit is None else sensor | {"unit_of_measurement": unit}


def _object_id(level: str) -> str:
    return "fltea_" + re.sub(r"[^A-Za-z0-9-]", lambda one: f"_{ord(one[0]):x}_", level)
