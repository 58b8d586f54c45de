# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files for a release and for the services that read them agree with the package."""

from __future__ import annotations

import json
import re
from pathlib import Path

import yaml
from click import Context

from haptic_accel import __version__
from haptic_accel.cli.commands import command_line

SOURCE = Path(__file__).resolve().parents[1]


def pythons() -> list[str]:
    (listed,) = re.findall(r"^PYTHONS = \((.*)\)$", (SOURCE / "setup.py").read_text(), re.M)
    return re.findall(r"3\.\d+", listed)


def test_citation_and_archive_name_this_version() -> None:
    citation = yaml.safe_load((SOURCE / "CITATION.cff").read_text())
    archive = json.loads((SOURCE / ".zenodo.json").read_text())
    assert citation["version"] == archive["version"] == __version__
    heading = f"{__version__} ({citation['date-released']})"
    assert heading in (SOURCE / "CHANGELOG.rst").read_text().splitlines()


def test_the_workflow_runs_the_same_checks_on_the_same_pythons() -> None:
    jobs = yaml.safe_load((SOURCE / ".github/workflows/ci.yml").read_text())["jobs"]
    assert any(step.get("run", "").endswith(".ci/run") for step in jobs["linux"]["steps"])
    assert jobs["without_ros"]["strategy"]["matrix"]["python"] == pythons()
    runs = [step.get("run", "") for step in jobs["without_ros"]["steps"]]
    files = [word for each in runs for word in each.split() if word.startswith("test/")]
    assert files
    assert all((SOURCE / file).is_file() for file in files)


def test_a_release_and_every_night_pass_the_whole_suite() -> None:
    workflow = yaml.safe_load((SOURCE / ".github/workflows/full.yml").read_text())
    # YAML reads the word "on" as true.
    assert {"schedule", "push"} <= set(workflow[True])
    assert workflow["jobs"]["linux"]["steps"][-1]["run"].endswith(".ci/full")
    full = (SOURCE / ".ci/full").read_text()
    assert {".ci/run", ".ci/pythons"} <= set(full.split())


def test_links_to_other_sites_are_checked_on_the_site_of_make_docs() -> None:
    jobs = yaml.safe_load((SOURCE / ".github/workflows/linkcheck.yml").read_text())["jobs"]
    commands = [step["run"] for step in jobs["linkcheck"]["steps"] if "run" in step]
    (of_make,) = re.findall(r"sphinx-build .* (-c \w+ \S+) ", (SOURCE / "Makefile").read_text())
    assert f"-b linkcheck {of_make} " in commands[-1]


def test_unit_tests_run_on_all_pythons_that_setup_allows() -> None:
    (listed,) = re.findall(
        r"^for version in (.*); do$", (SOURCE / ".ci/pythons").read_text(), re.M
    )
    assert listed.split() == pythons()


def test_the_extra_ros_and_make_have_the_same_distribution() -> None:
    (of_setup,) = re.findall(r'^ROS = "(\w+)"$', (SOURCE / "setup.py").read_text(), re.M)
    (of_make,) = re.findall(r"^ROS \?= (\w+)$", (SOURCE / "Makefile").read_text(), re.M)
    assert of_setup == of_make


def test_every_fragment_of_the_changelog_has_a_known_kind() -> None:
    others = {"README.md", "template.rst"}
    names = {path.name for path in (SOURCE / "changelog.d").iterdir()} - others
    kinds = ".change.rst", ".upgrade.rst"
    assert [name for name in sorted(names) if not name.endswith(kinds)] == []


def test_the_changes_of_a_version_are_read_in_two_minutes() -> None:
    fragments = (SOURCE / "changelog.d").glob("*.*.rst")
    texts = [path.read_text(encoding="utf-8").strip() for path in fragments]
    assert [text for text in texts if "\n" in text] == []
    changelog = (SOURCE / "CHANGELOG.rst").read_text(encoding="utf-8")
    _, newest, *_ = re.split(r"^[0-9.]+ \(.*\)\n-+$", changelog, flags=re.M)
    # 250 words a minute: Brysbaert 2019, silent reading of English.
    assert sum(len(text.split()) for text in texts) <= 2 * 250
    assert 0 < len(re.sub(r"^\* ", "", newest, flags=re.M).split()) <= 2 * 250


def test_pixi_has_the_ros_packages_of_the_manifest() -> None:
    manifest = (SOURCE / "package.xml").read_text()
    needed = re.findall(r"<exec_depend>((?!python3-)[a-z0-9_]+)</exec_depend>", manifest)
    named = re.findall(r"^ros-jazzy-([a-z0-9-]+) =", (SOURCE / "pixi.toml").read_text(), re.M)
    assert {name.replace("_", "-") for name in needed} == {*named} - {"rmw-fastrtps-cpp"}


def test_the_container_and_its_command_use_what_exists() -> None:
    text = (SOURCE / "Dockerfile").read_text()
    (command,) = re.findall(r"^CMD (.*)$", text, re.M)
    assert command_line.get_command(Context(command_line), json.loads(command)[1])
    container = json.loads((SOURCE / ".devcontainer/devcontainer.json").read_text())
    assert str(container["forwardPorts"][0]) in json.loads(command)
    assert (SOURCE / ".devcontainer" / container["build"]["dockerfile"]).is_file()
