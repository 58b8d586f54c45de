# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The layouts for other programs: well-formed, and about topics and fields that there are."""

from __future__ import annotations

import ast
import importlib
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from typing import Any

import yaml

from haptic_accel.core.topics import EMERGENCY_STOP, SIGNALS, TOPICS
from haptic_accel.graph.frames import description
from haptic_accel.materials.folders import config_folder
from haptic_accel.nodes.supervised_node import message_type

FOLDER = config_folder() / "layouts"
BY_NAME = {f"/{topic.name.lstrip('/')}": topic for topic in TOPICS}
NUMBERS = {"double", "float", "boolean"}


def check_number(topic: str, fields: list[str]) -> None:
    """Fail unless a topic has a number below a path of fields."""
    kind = message_type(BY_NAME[topic])
    for place, field in enumerate(fields):
        name = kind.get_fields_and_field_types()[field]
        if name in NUMBERS:
            assert place == len(fields) - 1, (topic, fields)
            return
        package, message = name.split("/")
        kind = getattr(importlib.import_module(f"{package}.msg"), message)
    raise AssertionError(f"{topic}: {fields}: not a number")


def check_slashes(path: str) -> None:
    """Check a curve as rqt_plot and PlotJuggler write it: topic and fields with slashes."""
    topic = max((name for name in BY_NAME if path.startswith(f"{name}/")), key=len)
    check_number(topic, path.removeprefix(f"{topic}/").split("/"))


def check_dots(path: str) -> None:
    """Check a message path as Foxglove writes it: fields with dots."""
    topic, *fields = path.split(".")
    check_number(topic, fields)


def test_rqt_opens_plots_of_what_there_is() -> None:
    perspective = json.loads((FOLDER / "rqt_plot.perspective").read_text())
    manager = perspective["groups"]["pluginmanager"]
    running = ast.literal_eval(manager["keys"]["running-plugins"]["repr"])
    plugins = {
        f"plugin__{plugin.replace('/', '__')}__{number}"
        for plugin, numbers in running.items()
        for number in numbers
    }
    assert plugins == set(manager["groups"])
    for group in manager["groups"].values():
        own = group["groups"]["plugin"]["keys"]
        keys = {name: ast.literal_eval(value["repr"]) for name, value in own.items()}
        # One topic is written without its list.
        topics = keys["topics"] if isinstance(keys["topics"], list) else [keys["topics"]]
        for path in topics:
            check_slashes(path)
        assert keys["x_limits"][0] < keys["x_limits"][1]


def test_plotjuggler_subscribes_to_what_it_plots() -> None:
    root = ElementTree.parse(FOLDER / "plotjuggler.xml").getroot()
    streamer = root.find("Plugins/plugin[@ID='ROS2 Topic Subscriber']")
    assert streamer is not None
    selected = streamer.find("selected_topics")
    assert selected is not None
    topics = selected.attrib["value"].split(";")
    assert set(topics) <= set(BY_NAME)
    curves = [
        curve.get(name, "")
        for plot in root.iter("plot")
        for curve in plot.iter("curve")
        for name in (["curve_x", "curve_y"] if plot.get("mode") == "XYPlot" else ["name"])
    ]
    for path in curves:
        check_slashes(path)
        assert any(path.startswith(f"{topic}/") for topic in topics), path
    for splitter in root.iter("DockSplitter"):
        shares = [float(share) for share in splitter.attrib["sizes"].split(";")]
        assert int(splitter.attrib["count"]) == len(shares) == len(splitter)
        assert abs(sum(shares) - 1) < 1e-9


def test_foxglove_shows_what_there_is() -> None:
    layout = json.loads((FOLDER / "foxglove.json").read_text())
    panels: dict[str, Any] = layout["configById"]
    assert sorted(placed(layout["layout"])) == sorted(panels)
    kinds = {name.split("!")[0] for name in panels}
    assert {"Plot", "DiagnosticSummary", "RawMessages", "Parameters"} <= kinds
    for name, panel in panels.items():
        for series in panel.get("paths", []):
            check_dots(series["value"])
        if panel.get("xAxisVal") == "custom":
            check_dots(panel["xAxisPath"]["value"])
        for key in ("topicPath", "topicToRender"):
            assert panel.get(key, "/diagnostics") in BY_NAME, name
        assert panel.get("serviceName", f"/{EMERGENCY_STOP.name}") == f"/{EMERGENCY_STOP.name}"
        json.loads(panel.get("requestPayload", "{}"))


def test_foxglove_plays_what_is_exported() -> None:
    layout = json.loads((FOLDER / "foxglove_audio.json").read_text())
    assert sorted(placed(layout["layout"])) == sorted(layout["configById"])
    assert {name.split("!")[0] for name in layout["configById"]} == {"Audio"}
    topics = {panel["topic"] for panel in layout["configById"].values()}
    assert topics == {"/audio/tool", "/audio/handle"}


def test_rviz_shows_what_there_is() -> None:
    layout = yaml.safe_load((FOLDER / "haptic_accel.rviz").read_text())["Visualization Manager"]
    robot = ElementTree.fromstring(description())
    links = {link.attrib["name"] for link in robot.iter("link")}
    assert layout["Global Options"]["Fixed Frame"] in links
    shown = [each for each in layout["Displays"] if "Topic" in each]
    for display in shown:
        topic = BY_NAME[display["Topic"]["Value"]]
        kind = display["Class"].removeprefix("rviz_default_plugins/").removesuffix("Stamped")
        assert topic.type == f"geometry_msgs/msg/{kind}Stamped", topic.name
        assert topic.frame in links
    (model,) = (each for each in layout["Displays"] if each["Class"].endswith("/RobotModel"))
    assert model["Description Topic"]["Value"] == "/robot_description"


def placed(node: Any) -> Iterator[str]:
    """Yield the panels of a mosaic."""
    if isinstance(node, str):
        yield node
    else:
        assert node["direction"] in ("row", "column")
        yield from placed(node["first"])
        yield from placed(node["second"])


def test_every_signal_of_the_actuator_is_on_every_layout() -> None:
    for file in {*FOLDER.iterdir()} - {FOLDER / "foxglove_audio.json"}:
        text = file.read_text()
        for topic in SIGNALS:
            if topic.name.startswith(("compensator", "master/handle")):
                assert f"/{topic.name}" in text, file.name
