# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of the machine and of ROS 2 for causes of timing jitter, with suggested fixes."""

from __future__ import annotations

import fcntl
import os
import re
import resource
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.core.tick.device_side import IN_TIME, MISSED_SHARE
from haptic_accel.graph.domain import DISCOVERY_RANGE, HIGHEST_FREE_DOMAIN, LOOPBACK_PROFILE

LITTLE_SHARED_MEMORY = 32.0
"""Free shared memory below which the middleware may run out of memory, MB."""

LITTLE_RECEIVE_BUFFER = 1 << 20
"""Receive buffer size below which a warning is given, bytes: Linux's default of 212992 holds about
30 ms of the graph's messages at 1 kHz, and the recorder may wait longer for a core."""

MUCH_TIMER_SLACK = 1000
"""Timer slack that delays ticks, ns; a node sets 1, Linux's default is 50000."""

LEAST_CORES, ENOUGH_CORES = 2, 4
"""Number of cores below which a graph cannot keep time, and from which separate processes need not
wait for each other: on two cores, 1 to 50 % of their forces were late at 1 kHz."""

CAP_SYS_NICE = 23
"""Bit number of the capability, from linux/capability.h."""

ADVICE = {
    "governor": (
        "the processor's clock is reduced between ticks, and raising it again delays them",
        "sudo cpupower frequency-set -g performance",
    ),
    "real-time permission": (
        "other programs can interrupt the nodes that compute forces",
        "'USER - rtprio 98' and 'USER - nice -20' in /etc/security/limits.conf, then log in"
        " again; in a container docker run --cap-add=sys_nice --ulimit rtprio=98",
    ),
    "cores": (
        "the processes of the graph have to wait for each other",
        "give it more cores: taskset, docker run --cpuset-cpus (instead of --cpus), or the"
        " settings of the virtual machine",
    ),
    "load": ("other programs compete for the cores", "stop other programs; top lists them"),
    "kernel": (
        "a system call of another program can delay a node by milliseconds",
        "a kernel with PREEMPT_DYNAMIC, booted with preempt=full, or with PREEMPT_RT",
    ),
    "swap": (
        "memory that was swapped out has to be read from the disk before a node can continue",
        "sudo swapoff -a, or close programs until it is not needed",
    ),
    "shared memory": (
        "killed processes left files behind, or a middleware that uses shared memory runs out",
        "fastdds shm clean, or with no ROS program running rm /dev/shm/fast*_*; for more space"
        " sudo mount -o remount,size=256m /dev/shm, in a container docker run --shm-size=256m",
    ),
    "receive buffer": (
        "messages are lost when a process is delayed",
        f"sudo sysctl -w net.core.rmem_max={4 << 20}",
    ),
    "sourced ROS": (
        "libraries of two ROS 2 installations are mixed in one process",
        "use a shell in which no setup.bash was sourced, or env -u PYTHONPATH"
        " -u AMENT_PREFIX_PATH -u LD_LIBRARY_PATH -u RMW_IMPLEMENTATION haptic-accel ...",
    ),
    "executor": (
        "callbacks start several times later and cost twice the processor time",
        "the events executor of ROS 2 Jazzy or newer",
    ),
    "rate": (
        "forces come late at that rate, whatever the nodes do",
        "stop other programs; on a virtual machine, others on its host may be the cause",
    ),
    "timer slack": (
        "the kernel may delay every tick by this time",
        "allow nodes prctl(PR_SET_TIMERSLACK), which a sandbox refuses",
    ),
    "middleware": (
        "this package's profile has no effect on it",
        "RMW_IMPLEMENTATION=rmw_fastrtps_cpp",
    ),
    "profile": (
        "the middleware runs with its own defaults",
        "unset the variable, or let it name an existing file",
    ),
    "discovery range": (
        "SUBNET lets nodes of other machines take part, with their traffic; LOCALHOST adds shared"
        " memory, which can hold up publishing; OFF keeps nodes from finding each other",
        f"unset {DISCOVERY_RANGE} and ROS_LOCALHOST_ONLY, unless it is what you chose",
    ),
    "domain": (
        "other programs may use the ports of this domain",
        f"a ROS_DOMAIN_ID of at most {HIGHEST_FREE_DOMAIN}",
    ),
    "other graph": (
        "two graphs in one domain receive each other's commands",
        "stop it, or give this graph another ROS_DOMAIN_ID",
    ),
}
"""Meaning and fix of a finding that is not ok, by the name of the check."""


@dataclass(frozen=True)
class Finding:
    """Result of one check; meaning and fix are empty if it is good."""

    name: str
    level: Literal["ok", "warning", "problem"]
    found: str
    meaning: str = ""
    fix: str = ""


def machine_findings() -> Iterator[Finding]:
    """Check the machine, without ROS."""
    cores = len(os.sched_getaffinity(0))
    governors = Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    yield governor([_text(path) for path in governors])
    rtprio = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    nice = resource.getrlimit(resource.RLIMIT_NICE)[0]
    yield realtime_permission(rtprio, nice, _text(Path("/proc/self/status")))
    yield processor(cores, _text(Path("/sys/fs/cgroup/cpu.max")))
    yield load(os.getloadavg()[0], cores)
    yield preemption(os.uname().version, _text(Path("/sys/kernel/realtime")))
    yield swap(_swapped(_text(Path("/proc/meminfo"))))
    yield shared_memory(Path("/dev/shm"))
    yield receive_buffer(_text(Path("/proc/sys/net/core/rmem_max")))
    yield sourced_ros(os.environ, Path(sys.prefix))


def governor(governors: Sequence[str]) -> Finding:
    """Judge the frequency governors of all cores."""
    slow = [name for name in governors if name != "performance"]
    found = f"{', '.join(sorted(set(slow)))} on {len(slow)} of {len(governors)} cores"
    if not slow:
        found = "performance" if governors else "none, as in a VM, whose host decides"
    return _judged("governor", found, warning=slow)


def realtime_permission(rtprio: int, nice: int, status: str) -> Finding:
    """Judge RLIMIT_RTPRIO, RLIMIT_NICE (-1 is no limit) and /proc/self/status."""
    capabilities = re.search(r"^CapEff:\s*([0-9a-f]+)$", status, re.MULTILINE)
    if capabilities and int(capabilities[1], 16) >> CAP_SYS_NICE & 1:
        rtprio = nice = -1
    highest = rtprio if rtprio >= 0 else 99
    lowest = min(20 - nice, 0) if nice >= 0 else -20
    found = f"real-time priority up to {highest}, niceness down to {lowest}"
    return _judged("real-time permission", found, warning=not highest)


def processor(cores: int, quota: str) -> Finding:
    """Judge the number of usable cores, and a control group's cpu.max."""
    limited = re.match(r"(\d+) (\d+)", quota)
    found = f"{cores}"
    if limited:
        found += f", paused after {int(limited[1]) / int(limited[2]):g} cores' worth of time"
    if LEAST_CORES <= cores < ENOUGH_CORES:
        found += ", too few for composed:=false"
    return _judged("cores", found, warning=limited, problem=cores < LEAST_CORES)


def load(mean: float, cores: int) -> Finding:
    """Judge the mean number of threads that ran, or waited to, in the last minute."""
    found = f"{mean:.1f} over the last minute, on {cores} cores"
    return _judged("load", found, warning=mean > cores / 2, problem=mean > cores)


def preemption(version: str, realtime: str) -> Finding:
    """Judge the kernel's preemption model, from ``uname -v`` and /sys/kernel/realtime."""
    models = ["PREEMPT_RT"] if realtime == "1" else re.findall(r"PREEMPT\w*", version)
    return _judged("kernel", models[0] if models else "not preemptible", warning=not models)


def _swapped(memory: str) -> int:
    """Return the swapped memory in ``/proc/meminfo``, bytes."""
    sizes = dict(re.findall(r"^(Swap\w+): +(\d+) kB$", memory, re.MULTILINE))
    return 1024 * (int(sizes.get("SwapTotal", 0)) - int(sizes.get("SwapFree", 0)))


def swap(used: int) -> Finding:
    """Judge the memory that was swapped out, in bytes."""
    return _judged("swap", f"{used / 1e6:.0f} MB in use", warning=used)


def shared_memory(folder: Path) -> Finding:
    """Judge the free space, and the Fast DDS segments of dead processes (without a lock).

    Only segments are checked: their names are never reused, so that trying a lock does no harm.
    """
    pattern = re.compile(r"(fastrtps|fastdds)_[0-9a-z]{16}_el")
    locks = [path for path in folder.glob("fast*_el") if pattern.fullmatch(path.name)]
    left = [lock.with_name(lock.name[:-3]) for lock in locks if not _is_locked(lock)]
    size = sum(path.stat().st_size for path in left if path.exists()) / 1e6
    free = shutil.disk_usage(folder).free / 1e6 if folder.is_dir() else 0.0
    found = f"{free:.0f} MB free, {len(left)} segments of dead processes with {size:.1f} MB"
    return _judged("shared memory", found, warning=left or free < LITTLE_SHARED_MEMORY)


def receive_buffer(rmem_max: str) -> Finding:
    """Judge net.core.rmem_max, the most bytes that a socket may store for a slow reader."""
    small = rmem_max and int(rmem_max) < LITTLE_RECEIVE_BUFFER
    found = f"net.core.rmem_max is {rmem_max or 'unknown'}"
    return _judged("receive buffer", found, warning=small)


def sourced_ros(environment: Mapping[str, str], prefix: Path) -> Finding:
    """Report a sourced ROS 2 that is mixed with the one in this Python's prefix."""
    index = Path("share", "ament_index")
    variables = ("PYTHONPATH", "AMENT_PREFIX_PATH")
    entries = ":".join(environment.get(variable, "") for variable in variables).split(":")
    other = [
        entry
        for entry in filter(None, entries)
        if not Path(entry).is_relative_to(prefix)
        and (Path(entry, "rclpy").is_dir() or Path(entry, index).is_dir())
    ]
    mixed = other and (prefix / index).is_dir()
    found = (", ".join(other) or "none") + (f", mixed with that in {prefix}" if mixed else "")
    return _judged("sourced ROS", found, problem=mixed)


def executor(name: str) -> Finding:
    """Judge the executor that nodes run on."""
    return _judged("executor", name, warning="events" not in name.lower())


def timer_slack(nanoseconds: str) -> Finding:
    """Judge the timer slack, by which the kernel may delay a node's timers; nodes set it."""
    much = nanoseconds and int(nanoseconds) > MUCH_TIMER_SLACK
    return _judged("timer slack", f"{nanoseconds} ns" if nanoseconds else "unknown", warning=much)


def middleware(name: str) -> Finding:
    """Judge the middleware."""
    return _judged("middleware", name, warning="fastrtps" not in name)


def profile(distribution: str, environment: Mapping[str, str], ours: Path) -> Finding:
    """Judge the file that Fast DDS reads; its version 3, from Kilted on, renamed the variable.

    Files in the folder `ours` are this package's.
    """
    variable = f"FAST{'RTPS' if distribution == 'jazzy' else 'DDS'}_DEFAULT_PROFILES_FILE"
    file = Path(environment[variable])
    if not file.is_file():
        return _judged("profile", f"{file}, named by {variable}: no such file", problem=True)
    own = f"set by {variable} in place of this package's"
    return _judged("profile", f"{file} ({'this package' if file.parent == ours else own})")


def discovery_range(environment: Mapping[str, str]) -> Finding:
    """Judge the range in which nodes discover each other."""
    reach = environment.get(DISCOVERY_RANGE, "").upper() or "SUBNET"
    if environment.get("ROS_LOCALHOST_ONLY") == "1":
        reach = "LOCALHOST"
    if reach == "SYSTEM_DEFAULT" and str(LOOPBACK_PROFILE) in environment.values():
        return _judged("discovery range", "this machine, without shared memory")
    return _judged("discovery range", reach, warning=True, problem=reach == "OFF")


def domain(number: str) -> Finding:
    """Judge ROS_DOMAIN_ID."""
    high = number.isdecimal() and int(number) > HIGHEST_FREE_DOMAIN
    return _judged("domain", number or "0", warning=high)


def other_graph(published: Sequence[str]) -> Finding:
    """Judge whether any of the graph's signals are already published."""
    found = f"publishes {', '.join(published)}" if published else "none in this domain"
    return _judged("other graph", found, problem=published)


def rate_held(loop: Mapping[str, Any]) -> Finding:
    """Judge the ticks of an empty loop on the sampling grid at the default rate."""
    missed, of, worst = loop["missed"], loop["of"], loop["lateness_us"]["max"]
    found = (
        f"{DEFAULT_RATE:g} Hz now: {missed} of {of} ticks more than {IN_TIME:g} periods late, the"
        f" latest by {worst:.0f} us"
    )
    return _judged("rate", found, warning=missed > MISSED_SHARE * of)


def _judged(name: str, found: str, *, warning: object = False, problem: object = False) -> Finding:
    """Return a finding, with meaning and fix where either condition is true."""
    if not warning and not problem:
        return Finding(name, "ok", found)
    return Finding(name, "problem" if problem else "warning", found, *ADVICE[name])


def _text(path: Path) -> str:
    """Return a file's text; empty if it cannot be read."""
    try:
        # The name of a process in /proc need not be UTF-8.
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _is_locked(path: Path) -> bool:
    try:
        with path.open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True  # the segment is locked, gone, or another user's
    return False
