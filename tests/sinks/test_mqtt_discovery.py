"""Tests that Home Assistant finds a device by the discovery messages that are published for it.

The keys were copied by hand from Home Assistant's documentation of version 2025.4, "MQTT discovery" (device
discovery) and "MQTT sensor". As in Home Assistant, Jinja renders the templates with the published payloads.
"""

import json
import re
from typing import Any

import jinja2
import pytest
from fltea.mqtt.connection import Up
from fltea.records.records import Fit
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.figures.figure import Entity
from fltea.sinks.figures.table import FIGURES
from fltea.sinks.mqtt.discovery import discovery_topic
from hypothesis import example, given
from hypothesis import strategies as st

from tests.rig.example_records import STATS
from tests.rig.fit_support import FRACTIONAL
from tests.rig.host_support import ROOT
from tests.rig.mqtt_support import Bench, MakeBench, make_bench, stats

TOPIC = "homeassistant/device/fltea_a0/config"
DEVICE_KEYS = {
    "identifiers", "connections", "manufacturer", "model", "model_id", "name", "hw_version", "serial_number",
    "sw_version", "via_device", "suggested_area", "configuration_url",
}  # fmt: skip
ROOT_KEYS = {
    "device", "origin", "components", "availability", "availability_mode", "availability_template",
    "availability_topic", "payload_available", "payload_not_available", "command_topic", "state_topic",
    "qos", "encoding",
}  # fmt: skip
SENSOR_KEYS = {
    "platform", "unique_id", "name", "state_topic", "value_template", "unit_of_measurement", "state_class",
    "device_class", "json_attributes_topic", "json_attributes_template", "entity_category", "icon",
    "expire_after", "force_update", "object_id", "enabled_by_default", "suggested_display_precision",
    "options", "qos", "encoding",
}  # fmt: skip
BINARY_SENSOR_KEYS = {*SENSOR_KEYS, "payload_on", "payload_off", "off_delay"} - {"state_class", "options"}
IDENTITIES = {
    "fltea_a0_lost", "fltea_a0_moves", "fltea_a0_gyro_x_noise", "fltea_a0_gyro_x_alpha", "fltea_a0_gyro_x_f",
    "fltea_a0_gyro_x_bias", "fltea_a0_gyro_x_bias_std", "fltea_a0_gyro_x_steps", "fltea_a0_accel_z_noise",
    "fltea_a0_accel_z_alpha", "fltea_a0_accel_z_f", "fltea_a0_accel_z_bias", "fltea_a0_accel_z_bias_std",
    "fltea_a0_accel_z_steps",
}  # fmt: skip
FIT = Fit(99, 1, 0, 0, 100, {"gyro_x": FRACTIONAL, "accel_z": FRACTIONAL}, device="due")


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> MakeBench:
    return make_bench(monkeypatch)


def found(bench: Bench) -> list[dict[str, Any]]:
    return [json.loads(payload) for topic, payload, *_ in bench.connection.sent if topic == TOPIC]


def test_nothing_is_published_for_home_assistant_unless_it_is_asked_for(bench: MakeBench) -> None:
    b = bench()
    b.write(stats())
    assert all(topic.startswith("fltea/") for topic, *_ in b.connection.sent)


def test_configuration_has_the_documented_keys_and_an_identity_for_each_sensor(bench: MakeBench) -> None:
    b = bench(discovery="homeassistant")
    b.write(stats(), stats())
    (sent,) = [(qos, retain) for topic, _, qos, retain in b.connection.sent if topic == TOPIC]
    assert sent == (1, True)
    (config,) = found(b)
    assert config.keys() <= ROOT_KEYS
    assert config["device"].keys() <= DEVICE_KEYS
    assert config["device"]["identifiers"] == ["fltea_a0"]
    assert config["origin"]["name"] == "fltea"
    sensors = config["components"].values()
    keys = {"sensor": SENSOR_KEYS, "binary_sensor": BINARY_SENSOR_KEYS}
    assert all(one.keys() <= keys[one["platform"]] for one in sensors)
    assert len({one["unique_id"] for one in sensors}) == len(sensors)
    assert {one["unique_id"] for one in sensors} == IDENTITIES, (
        "a person's automations name these: none may change or go, and a new one is added to IDENTITIES"
    )


def test_the_guide_names_each_entity() -> None:
    guide = (ROOT / "host/docs/guide/outputs.md").read_text(encoding="utf-8")
    _, _, section = guide.partition("**Home Assistant**")
    titles = [one.home_assistant.title for one in FIGURES if isinstance(one.home_assistant, Entity)]
    missing = [title for title in titles if f"*{title}*" not in section.partition("\n## ")[0]]
    assert not missing, f"host/docs/guide/outputs.md, Home Assistant: name the entities {missing} as *title*"


def rendered(template: str, payload: bytes) -> str:
    return jinja2.Template(template).render(value_json=json.loads(payload))


def test_templates_take_the_figures_out_of_what_is_published(bench: MakeBench) -> None:
    b = bench(discovery="homeassistant")
    b.write(stats(), FIT)
    (config,) = found(b)
    last = {topic: payload for topic, payload, *_ in b.connection.sent}
    values = {
        key: rendered(one["value_template"], last[one["state_topic"]])
        for key, one in config["components"].items()
    }
    tracker = STATS.axes["gyro_x"].tracker
    assert tracker is not None
    assert values["lost"] == str(STATS.sample_counts.lost)
    assert values["gyro_x_noise"] == FRACTIONAL.verdict
    assert float(values["gyro_x_alpha"]) == FRACTIONAL.alpha.value
    assert float(values["gyro_x_f"]) == FRACTIONAL.f.value
    assert values["gyro_x_bias"] == str(tracker.bias)
    assert values["gyro_x_steps"] == str(tracker.steps)
    # Home Assistant reads the state "None" as "unknown". A binary sensor needs the state "ON" or "OFF".
    assert values["accel_z_bias"] == values["accel_z_steps"] == "None"
    assert values["moves"] == "ON"
    template = config["components"]["moves"]["value_template"]
    still = json.dumps({"axes": {"gyro_x": {"tracker": {"moving": False}}, "accel_z": {"tracker": None}}})
    assert rendered(template, still.encode()) == "OFF"
    assert config["components"]["accel_z_bias"]["unit_of_measurement"] == STATS.axes["accel_z"].unit
    alpha = config["components"]["gyro_x_alpha"]
    attributes = json.loads(rendered(alpha["json_attributes_template"], last[alpha["json_attributes_topic"]]))
    assert (attributes["low"], attributes["high"]) == (FRACTIONAL.alpha.low, FRACTIONAL.alpha.high)
    states = {
        status: rendered(config["availability_template"], json.dumps({"status": status}).encode())
        for status in ("online", "stalled", "offline")
    }
    assert states == {"online": "online", "stalled": "offline", "offline": "offline"}
    assert config["availability_topic"] in last


def test_configuration_comes_again_with_a_new_connection(bench: MakeBench) -> None:
    b = bench(discovery="homeassistant")
    b.write(stats())
    first = b.connection
    first.close()
    b.sink.flush()
    b.wait(60)
    assert b.connection is not first
    b.happens(Up())
    assert len(found(b)) == 1


@example("a+", "a_2b_")
@given(st.text(min_size=1, max_size=40), st.text(min_size=1, max_size=40))
def test_topics_are_of_letters_that_home_assistant_takes_and_differ_as_names_do(one: str, other: str) -> None:
    topics = [discovery_topic("homeassistant", name) for name in (one, other)]
    assert all(re.fullmatch(r"homeassistant/device/[a-zA-Z0-9_-]+/config", topic) for topic in topics)
    assert (topics[0] == topics[1]) == (one == other)


def test_prefix_is_a_topic() -> None:
    with pytest.raises(ValueError, match="discovery must be a topic"):
        MqttConfig(discovery="home/+/assistant")
