# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package as colcon installs it and as `ros2 run` and `ros2 launch` find it."""

from __future__ import annotations

import ast
import itertools
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import PathDistribution
from operator import itemgetter
from pathlib import Path

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import Package, parse_package
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from haptic_accel import __version__
from haptic_accel.bags import NO_ROSBAGS, OF_ROSBAGS
from haptic_accel.core.outside import node_module
from running import python

SOURCE = Path(__file__).resolve().parents[1]
NODES = (
    *("master_device", "slave_device", "coupler", "compensator", "recorder", "identifier"),
    *("restamper", "scope", "link"),
)

SAME = ("aiohttp", "click", "jinja2", "matplotlib", "numpy", "pandas", "rich", "scipy", "yaml")
ROSDEP_KEYS = {
    **{module: f"python3-{module}" for module in SAME},
    "contourpy": "python3-matplotlib",  # needs it
    "ruamel": "python3-ruamel.yaml",
}
"""Key of each module that is no ROS package; a ROS package's key is its name."""

OPTIONAL = {
    *("can", "cobs", "cryptography", "distributed", "h5py", "mujoco", "PIL", "psutil"),
    *("pyarrow", "serial", "sounddevice", "trimesh", "zenoh", *OF_ROSBAGS),
}
"""Modules of extras, and those that have no key, or one for pip, which Ubuntu 24.04 refuses; their
absence is said."""

WITHOUT_KEY = {"rosbags", "backports.zstd", "lz4"}
"""What `setup.py` requires of pip alone: rosbags, and what comes with it."""


class Installation:
    """The folder colcon installed the package into, and commands in its environment."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.prefix = folder / "haptic_accel"
        self.share = self.prefix / "share" / "haptic_accel"
        self.executables = self.prefix / "lib" / "haptic_accel"
        (initial,) = self.prefix.glob("**/haptic_accel/__init__.py")
        self.code = initial.parent

    def run(self, *command: str | Path) -> str:
        """Run a command as after sourcing the workspace and return what it printed."""
        source = ["sh", "-c", '. "$COLCON_CURRENT_PREFIX/local_setup.sh"; exec "$@"', "sh"]
        environment = plain_environment() | {"COLCON_CURRENT_PREFIX": str(self.folder)}
        return run([*source, *map(str, command)], environment, self.folder)


def plain_environment() -> dict[str, str]:
    """Return the environment with no workspace but the one that ROS 2 itself is in."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return environment | {"AMENT_PREFIX_PATH": os.environ.get("AMENT_PREFIX_PATH", sys.prefix)}


def run(command: Sequence[str], environment: dict[str, str], folder: Path) -> str:
    done = subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installation(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    workspace = tmp_path_factory.mktemp("workspace")
    colcon = [sys.executable, "-m", "colcon", "--log-base", "log", "build"]
    places = ["--paths", str(SOURCE), "--build-base", "build", "--install-base", "install"]
    run([*colcon, *places], plain_environment(), workspace)
    return Installation(workspace / "install")


@pytest.fixture(scope="module")
def manifest() -> Package:
    warnings: list[str] = []
    package = parse_package(SOURCE / "package.xml", warnings=warnings)
    assert warnings == []
    return package


@pytest.mark.parametrize("name", [*NODES, "haptic-accel"])
def test_executable_is_where_ros2_run_looks(installation: Installation, name: str) -> None:
    assert os.access(installation.executables / name, os.X_OK)


def test_ament_index_finds_the_package(installation: Installation) -> None:
    script = "from ament_index_python import packages as found;"
    script += "print(found.get_package_prefix('haptic_accel'))"
    assert installation.run(sys.executable, "-c", script).strip() == str(installation.prefix)


INSTALLED = ["launch", "config", "haptic_accel/pages/templates", "haptic_accel/pages/assets"]


@pytest.mark.parametrize("folder", INSTALLED)
def test_every_file_of_a_folder_is_installed(installation: Installation, folder: str) -> None:
    place = installation.code.parent if folder.startswith("hap") else installation.share
    assert contents(place / folder) == contents(SOURCE / folder) != {}
    assert (installation.code / "py.typed").is_file(), "type checkers of others see the types"


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_installed_code_reads_the_installed_files(installation: Installation) -> None:
    script = (
        "import haptic_accel; from haptic_accel.materials.folders import share_folder;"
        "print(haptic_accel.__path__[0]); print(share_folder())"
    )
    printed = installation.run(sys.executable, "-c", script).splitlines()
    assert printed == [str(installation.code), str(installation.share)]


def test_this_command_alone_is_on_the_path_of_a_sourced_workspace(
    installation: Installation,
) -> None:
    found = installation.run("sh", "-c", "command -v haptic-accel").strip()
    assert found == str(installation.share / "bin" / "haptic-accel")
    assert "Usage: haptic-accel" in installation.run("haptic-accel", "teleop", "--help")
    assert [path.name for path in (installation.share / "bin").iterdir()] == ["haptic-accel"]


def test_manifest_tells_colcon_and_the_build_farm_what_it_is(manifest: Package) -> None:
    assert manifest.name == "haptic_accel"
    assert manifest.package_format == 3
    assert manifest.licenses == ["Apache-2.0"]
    assert manifest.get_build_type() == "ament_python"
    assert [author.name for author in manifest.authors] == ["haptic_accel maintainers"]


def test_versions_agree(installation: Installation, manifest: Package) -> None:
    (metadata,) = installation.code.parent.glob("haptic_accel-*-info")
    assert PathDistribution(metadata).version == manifest.version == __version__


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse")  # a call of catkin_pkg's own
def test_release_tools_find_the_changes_of_each_version(manifest: Package) -> None:
    """`catkin_prepare_release` and bloom read sections that are named by version and date."""
    changes = get_changelog_from_path(SOURCE, manifest.name)
    found = [(version, date) for version, date, _ in changes.foreach_version(reverse=True)]
    headings = re.findall(r"^(\d\S*) \(", (SOURCE / "CHANGELOG.rst").read_text(), re.M)
    assert [version for version, _ in found] == headings
    assert found[0][0] == manifest.version
    assert found == sorted(found, key=itemgetter(1), reverse=True)


def requirements(only: str = "") -> dict[str, SpecifierSet]:
    """Return the versions that setup.py allows of each package that users need, by name.

    These are those of one extra, or of all.
    """
    show = "lambda **own: print(json.dumps([own['install_requires'], own['extras_require']]))"
    code = f"import json, setuptools; setuptools.setup = {show}; exec(open('setup.py').read())"
    required, optional = json.loads(run([sys.executable, "-c", code], plain_environment(), SOURCE))
    of_users = [own for name, own in optional.items() if (name == only if only else name != "dev")]
    words = [each for each in itertools.chain(required, *of_users) if not each.startswith("ros-")]
    return {found.name: found.specifier for found in map(Requirement, words)}


def bounds(versions: SpecifierSet, operators: set[str]) -> list[str]:
    return [each.version for each in versions if each.operator in operators]


def test_every_dependency_has_the_bounds_of_the_policy() -> None:
    """CONTRIBUTING.md: a lower bound each; an upper one for what broke before or is below 1."""
    found = requirements()
    assert [name for name, versions in found.items() if not bounds(versions, {">="})] == []
    bounded = {name for name, versions in found.items() if bounds(versions, {"<"})}
    assert bounded == {"aiohttp", "mujoco", "rosbags", "trimesh"}
    policy = (SOURCE / "CONTRIBUTING.md").read_text()
    assert all(name in policy for name in bounded)


def test_manifest_and_setup_bound_the_same_versions(manifest: Package) -> None:
    stated = {each.name: each for each in manifest.exec_depends if each.version_lt}
    assert set(stated) == {"python3-aiohttp"}
    versions = requirements()["aiohttp"]
    assert bounds(versions, {"<"}) == [stated["python3-aiohttp"].version_lt]
    assert bounds(versions, {">="}) == [stated["python3-aiohttp"].version_gte]


def test_manifest_and_setup_require_the_same_packages(manifest: Package) -> None:
    names = requirements("analysis").keys() - WITHOUT_KEY
    stated = {each.name for each in manifest.exec_depends if each.name.startswith("python3-")}
    assert stated == {f"python3-{name.lower().removeprefix('py')}" for name in names}


def test_manifest_names_the_packages_that_launch_files_start(manifest: Package) -> None:
    source = (SOURCE / "haptic_accel" / "graph" / "launching.py").read_text()
    started = set(re.findall(r'_installed\("(\w+)"\)|package="(\w+)"', source))
    found = {name for names in started for name in names if name}
    assert {"robot_state_publisher", "tf2_ros"} <= found
    assert found <= {each.name for each in manifest.exec_depends} | {"haptic_accel"}


def test_every_import_is_a_dependency(manifest: Package) -> None:
    keys = {ROSDEP_KEYS.get(module, module) for module in third_party_imports()}
    assert keys <= {dependency.name for dependency in manifest.exec_depends}


def without(modules: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a Python that lacks some modules."""
    hidden = f"import sys; sys.modules.update(dict.fromkeys({modules}))"
    return python("-c", f"{hidden}; {code}")


ANALYSIS = ("matplotlib", "pandas")
"""Modules of the extra `analysis`."""


def test_the_graph_runs_without_rosbags_and_analysis() -> None:
    nodes = ", ".join(node_module(node) for node in NODES if node != "recorder")
    done = without(
        (*OF_ROSBAGS, *ANALYSIS),
        f"import {nodes}; from haptic_accel.setup.processes import graph;"
        "from haptic_accel.setup.arguments import GraphArguments;"
        "print(len(graph(GraphArguments(record=False, composed=False))))",
    )
    assert (done.stdout, done.stderr) == ("4\n", "")


NEED_ROSBAGS = [(["bag", "info", "bag"], 1), (["teleop", "duration:=1"], 2)]


@pytest.mark.parametrize(("words", "status"), NEED_ROSBAGS)
def test_what_needs_rosbags_says_so(words: list[str], status: int) -> None:
    done = without(OF_ROSBAGS, f"from haptic_accel.cli.main import main; main({words})")
    assert done.returncode == status
    assert NO_ROSBAGS in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["experiment", "identify", "touch", "replay", "export"])
def test_what_draws_says_what_to_install_and_the_rest_runs(command: str) -> None:
    done = without(ANALYSIS, f"from haptic_accel.cli.main import main; main(['{command}', '-h'])")
    draws = command == "experiment"
    assert done.returncode == draws
    needed = r"haptic-accel: needs \w+: pip install 'haptic_accel\[analysis\]'\n" if draws else ""
    assert re.fullmatch(needed, done.stderr)


NEWER = {"compression"}
"""In the standard library from Python 3.14 on."""


def third_party_imports() -> set[str]:
    files = [*SOURCE.glob("haptic_accel/**/*.py"), *SOURCE.glob("launch/*.py")]
    modules = {module for file in files for module in imports(ast.parse(file.read_bytes()))}
    return modules - set(sys.stdlib_module_names) - NEWER - OPTIONAL - {"haptic_accel"}


def imports(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]
