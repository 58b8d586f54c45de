# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The documentation: its tables agree with the code, its links lead somewhere."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from matplotlib import pyplot

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.process import module_command
from haptic_accel.core.topics import HAND_SET_POINT, JOINT_STATES, ON_DEMAND, TOPICS
from haptic_accel.setup.node_parameters import NODES, node_schema
from running import Start, python

SOURCE = Path(__file__).resolve().parents[2]
FOLDERS = "docs", "haptic_accel", "test/chaos"
DOCS = sorted(page for folder in FOLDERS for page in (SOURCE / folder).rglob("*.md"))
PAGES = [*DOCS, *sorted(SOURCE.glob("*.md"))]
MOST_PAGES, MOST_BYTES = 15, 170_000
"""Most pages that concern everybody, and their size; kits and devices have their own."""

READERS = re.compile(r"^\*For: [^*]+\.\*$", re.MULTILINE)
LINK = re.compile(r"(?<!\\)\[[^\]]*\]\(([^)\s]+)\)")
PYTHON = re.compile(r"```python\n(.*?)```", re.DOTALL)
PAGE = re.compile(r"\bdocs/\w+\.md")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def name_of(page: Path) -> str:
    return str(page.relative_to(SOURCE))


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, SOURCE / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def anchors(page: Path) -> set[str]:
    """Return the names by which a page's headings are linked."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings}


@pytest.mark.parametrize("page", DOCS, ids=name_of)
def test_tables_are_those_of_the_code(page: Path) -> None:
    text = page.read_text()
    assert script("tables").with_tables(text) == text, "run: python docs/tables.py"


def test_errors_are_drawn_against_both_bounds() -> None:
    bound = {"bound_percent": 1.0, "limited_bound_percent": 3.0}
    errors = {"none": 100.0, "inverse": 4.0}
    rows = [{"controller": each, "nrmse_percent": errors[each], **bound} for each in errors]
    limited, free = script("figures").bounds(rows).axes
    for axes, bound in ((limited, 3.0), (free, 1.0)):
        points = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
        assert points["none"] == [[bound, 100.0]]
        assert points["inverse"] == [[bound, 4.0]]
        assert "%" in axes.get_xlabel()


def test_every_table_of_the_code_has_one_place() -> None:
    pages = "".join(page.read_text() for page in DOCS)
    marked = re.findall(r"<!-- table: (\w+)", pages)
    assert sorted(marked) == sorted(script("tables").TABLES)


def test_the_table_of_parameters_has_each_parameter_of_each_node() -> None:
    text = script("tables").parameters()
    listed = {
        (node, name)
        for section in text.split("\n### ")[1:]
        for node in section.partition("\n")[0].split(", ")
        for name in re.findall(r"^\| `(.+?)` \|", section, re.MULTILINE)
    }
    assert listed == {(node, name) for node in NODES for name in node_schema(node)}


def test_the_table_of_topics_is_that_of_the_code() -> None:
    text = (SOURCE / "docs" / "ros2.md").read_text()
    section = text.split("### Topics\n")[1].split("\n### ")[0]
    listed = {
        (name, kind.replace("/", "/msg/"), "latched" in line)
        for line in section.splitlines()
        if line.startswith("| `")
        for names, kind in [re.match(r"\| (.*?) \| `(.*?)`", line).groups()]  # type: ignore[union-attr]
        for name in re.findall(r"`([^`]+)`", names)
    }
    topics = (*TOPICS, JOINT_STATES, HAND_SET_POINT, *ON_DEMAND)
    assert listed == {(topic.name, topic.type, topic.latched) for topic in topics}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for link in LINK.findall(FENCE.sub("", page.read_text())):
        if "://" in link or link.startswith("mailto:"):
            continue
        path, _, anchor = link.partition("#")
        target = page if not path else page.parent / path
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


def test_every_page_that_a_file_names_exists() -> None:
    patterns = "*.md", "config/**/*.yaml", "haptic_accel/**/*.py", "haptic_accel/**/*.j2"
    files = [path for pattern in patterns for path in SOURCE.glob(pattern)]
    texts = ((name_of(path), path.read_text(encoding="utf-8")) for path in files)
    named = {(name, page) for name, text in texts for page in PAGE.findall(text)}
    assert named
    assert [each for each in sorted(named) if not (SOURCE / each[1]).is_file()] == []


@pytest.mark.parametrize("page", DOCS, ids=name_of)
def test_every_page_says_for_whom_it_is(page: Path) -> None:
    title, blank, readers = page.read_text().splitlines()[:3]
    assert title.startswith("# ")
    assert not blank
    assert READERS.match(readers), readers


def test_the_pages_can_be_read_by_one_person() -> None:
    general = [page for page in DOCS if page.parent.name == "docs"]
    assert len(general) <= MOST_PAGES
    assert sum(page.stat().st_size for page in general) <= MOST_BYTES


def test_every_page_is_in_the_index() -> None:
    index = (SOURCE / "docs" / "README.md").read_text()
    listed = {(SOURCE / "docs" / link).resolve() for link in LINK.findall(index)}
    assert set(DOCS) - {SOURCE / "docs" / "README.md"} <= listed


FAILING = """

class FailingController(HalfController):
    left = 1000

    def force(self, *accelerations: float) -> float:
        self.left -= 1
        return super().force(*accelerations) / min(1, max(0, self.left))
"""
FAILED = "controller failing: raised ZeroDivisionError: float division by zero; none took over"


@pytest.fixture(scope="module")
def recipes(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Install the packages that CONTRIBUTING.md shows in an empty folder; return Python's path."""
    if not (find_spec("wheel") or find_spec("setuptools.command.bdist_wheel")):
        pytest.skip("pip cannot install packages here: the extra test is not installed")
    text = (SOURCE / "CONTRIBUTING.md").read_text()
    half, arm, verb = PYTHON.findall(text)
    control, device, kit = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    half, control = half + FAILING, f'{control}failing = "lab_control.half:FailingController"'
    kit = device.partition("[project.entry")[0].replace("lab_arm", "lab_kit") + kit
    weighing = "import click\n\n@click.command()\ndef weigh():\n    click.echo('0.064 kg')\n"
    made = tmp_path_factory.mktemp("made")
    written = {
        "lab_control": {"pyproject.toml": control, "lab_control/half.py": half},
        "lab_arm": {"pyproject.toml": device, "lab_arm/device.py": arm},
        "lab_kit": {"pyproject.toml": kit, "lab_kit/commands.py": verb},
    }
    written["lab_kit"]["lab_kit/weighing.py"] = weighing
    for package, files in written.items():
        for name, content in files.items():
            (made / package / name).parent.mkdir(parents=True, exist_ok=True)
            (made / package / name).write_text(content)
    site = tmp_path_factory.mktemp("site")
    install = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q"]
    without = ["--no-deps", "--no-build-isolation", "--no-index"]
    packages = [str(made / package) for package in written]
    subprocess.run([*install, *without, "--target", str(site), *packages], check=True)
    return str(site)


def run_with(recipes: str, *words: str) -> subprocess.CompletedProcess[str]:
    _, *main = module_command("haptic_accel.cli.main")
    return python(*main, *words, env=os.environ | {"PYTHONPATH": recipes})


def took_over(bag: Path) -> object:
    """Return the last controller of a bag."""
    return [each.value for each in read_bag(bag).changes if each.parameter == "controller"][-1]


def test_the_controller_that_contributing_shows_runs(recipes: str, here: Path) -> None:
    (here / "twice.yaml").write_text("compensator: {ros__parameters: {half.mass: 0.128}}")
    words = "duration:=2", "surface:=text", "params_file:=twice.yaml", "--out", "trials"
    chosen = "constant,half,failing"
    done = run_with(recipes, "experiment", "--lockstep", "--controllers", chosen, *words)
    assert (done.returncode, done.stderr) == (0, f"{FAILED}\n")
    assert took_over(here / "trials/bags/text_failing") == "none"
    errors = dict(re.findall(r"text / (\w+) / seed 0: (.*) %", done.stdout))
    assert errors["half"] == errors["constant"]  # with twice its mass


def test_the_driver_that_contributing_shows_is_one(recipes: str) -> None:
    done = run_with(recipes, "teleop", "master:=lab_arm", "rate:=0")
    assert done.stderr.startswith("haptic-accel: rate = 0")
    done = run_with(recipes, "teleop", "master:=lab_leg")
    more = "packages add more by the entry point haptic_accel.masters"
    assert f"crtk_serial, lab_arm; {more}" in done.stderr


def test_the_verb_that_contributing_shows_runs(recipes: str) -> None:
    done = run_with(recipes, "weigh")
    assert (done.stdout, done.stderr) == ("0.064 kg\n", "")


@pytest.mark.live
@pytest.mark.slow
def test_a_graph_runs_with_the_controller_and_the_driver_of_packages(
    recipes: str, haptic_accel: Start, monkeypatch: pytest.MonkeyPatch, here: Path
) -> None:
    monkeypatch.setenv("PYTHONPATH", recipes)
    words = "master:=lab_arm", "controller:=failing", f"bag:={here / 'bag'}"
    graph = haptic_accel("teleop", *words)
    graph.wait_for("engaged")
    graph.wait_for(FAILED)
    assert graph.end(signal.SIGINT) == 0, graph.text
    assert took_over(here / "bag") == "none"


def test_the_notebook_of_the_page_runs() -> None:
    (code,) = PYTHON.findall((SOURCE / "docs" / "api.md").read_text())
    names: dict[str, Any] = {}
    pyplot.switch_backend("agg")
    exec(code, names)
    pyplot.close("all")
    shown = set(names["trial"].frame().reset_index().columns)
    assert shown >= {"time_s", "tool_acceleration_m_s2", "actuator_force_N"}


def test_the_readme_is_short() -> None:
    assert len((SOURCE / "README.md").read_text().splitlines()) <= 120


@pytest.mark.parametrize("picture", sorted((SOURCE / "docs").glob("*.svg")), ids=lambda p: p.name)
def test_pictures_are_well_formed(picture: Path) -> None:
    assert ElementTree.parse(picture).getroot().tag.endswith("svg")
