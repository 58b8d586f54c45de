"""``haptic-accel doctor``: what on this machine hurts real time, and how to mend it.

Nothing is changed. What the machine says of itself is read here. What only a node knows, and
the timing, comes from two processes that run as the graph's nodes do: this module as a program.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from haptic_accel.cli.options import Verb, json_option
from haptic_accel.core.cdr import unpack_stamped_vector
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, EXECUTOR, FAILED, SUPERVISOR
from haptic_accel.core.topics import SIGNALS, TOOL_ACCELERATION, Topic
from haptic_accel.graph.files import config_folder
from haptic_accel.nodes.middleware import DISCOVERY_RANGE, LOOPBACK_PROFILE, VARIABLES

if TYPE_CHECKING:
    from haptic_accel.nodes.scheduling import SupervisedNode

RATE = 1000.0
"""Of the timer that is measured, Hz: the paper's."""

DISCOVERY = 10.0
"""Time for the two processes to find each other before they measure as they are, s."""

ANNOUNCEMENT = 3.5
"""Time to look for other nodes, s; Fast DDS announces every 3 s where no profile says more."""

PATIENCE = 30.0
"""Longest time for the two processes besides what they measure, s."""

LOOK_PERIOD = 0.1
"""How often these two look whether to begin and to end, s."""

LITTLE_SHARED_MEMORY = 32.0
"""MB; a process takes half of one, a recorder's more, and several graphs may run."""

LITTLE_RECEIVE_BUFFER = 1 << 20
"""Bytes; Linux's default of 212992 holds some 20 ms of the graph's messages at 5 kHz."""

HIGHEST_DOMAIN = 101
"""Above it, the ports of a ROS domain are among those that Linux hands out (ROS 2 docs)."""

MUCH_TIMER_SLACK = 1000
"""ns; a node's is 1, Linux's default 50000."""

CAP_SYS_NICE = 23
"""Bit number, from linux/capability.h."""

QUANTILES = {"p50": 0.5, "p99": 0.99, "p99_9": 0.999, "max": 1.0}
"""What is told of durations, by label."""

Level = Literal["ok", "warning", "problem"]
COLOURS = {"ok": "green", "warning": "yellow", "problem": "red"}


@dataclass(frozen=True)
class Finding:
    """One thing looked at: how bad it is, what was found, how to mend it."""

    name: str
    level: Level
    found: str
    mend: str = ""


class UnusableError(Exception):
    """ROS 2 cannot be used; the message is the reason in one line."""


@click.command(cls=Verb)
@click.option("--seconds", type=float, default=5.0, help="Length of the timer measurement, s.")
@json_option
def doctor(seconds: float, json_file: Path | None) -> int:
    """Find causes of timing jitter on this machine and suggest fixes.

    Also measures the lateness of a 1 kHz timer. Nothing is changed.
    """
    if not 0.1 <= seconds <= 3600:
        raise ParameterError(f"seconds = {seconds:g}: must be from 0.1 to 3600 s")
    console = Console()
    findings = list(machine_findings())
    console.print(f"measuring for {seconds:g} s", highlight=False)
    facts: dict[str, Any] = {}
    unusable = ""
    try:
        facts = measure(seconds)
        findings += node_findings(facts)
    except UnusableError as error:
        unusable = str(error)
    console.print(_table(findings))
    if json_file:
        _write(json_file, findings, facts)
    if unusable:
        print(f"haptic-accel: rclpy cannot be used: {unusable}", file=sys.stderr)
        return FAILED
    return DONE


def machine_findings() -> Iterator[Finding]:
    """Look at the machine, without ROS."""
    cores = len(os.sched_getaffinity(0))
    governors = Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    yield governor([_text(path) for path in governors])
    rtprio = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    nice = resource.getrlimit(resource.RLIMIT_NICE)[0]
    yield realtime_permission(rtprio, nice, _text(Path("/proc/self/status")))
    yield processor(cores, _text(Path("/sys/fs/cgroup/cpu.max")))
    yield load(os.getloadavg()[0], cores)
    yield preemption(os.uname().version, _text(Path("/sys/kernel/realtime")))
    shared_memory = Path("/dev/shm")
    free = shutil.disk_usage(shared_memory).free if shared_memory.is_dir() else 0
    yield space(free / 1e6)
    yield leftovers(shared_memory)
    yield receive_buffer(_text(Path("/proc/sys/net/core/rmem_max")))
    yield sourced_ros(os.environ, Path(sys.prefix))


def node_findings(facts: Mapping[str, Any]) -> Iterator[Finding]:
    """Judge what the two processes told, as `measure` returns it."""
    environment = facts["environment"]
    yield Finding("ROS 2", "ok", f"{facts['distribution'] or 'unknown'}, rclpy {facts['rclpy']}")
    yield executor(facts["executor"])
    yield timer_slack(facts["timer_slack"])
    yield middleware(facts["middleware"])
    if "fastrtps" in facts["middleware"]:
        yield profile(facts["distribution"], environment, config_folder())
    yield discovery_range(environment)
    yield domain(environment["ROS_DOMAIN_ID"])
    yield other_graph(facts["published"])
    yield lateness(facts["lateness_us"])
    yield age(facts["age_us"])


def governor(governors: Sequence[str]) -> Finding:
    """Judge the frequency governors of all cores."""
    slow = [name for name in governors if name != "performance"]
    found = f"{', '.join(sorted(set(slow)))} on {len(slow)} of {len(governors)} cores"
    if not slow:
        found = "performance" if governors else "none here, as in a VM, whose host decides"
    mend = "sudo cpupower frequency-set -g performance"
    return _judged("governor", "warning" if slow else "ok", found, mend)


def realtime_permission(rtprio: int, nice: int, status: str) -> Finding:
    """Judge RLIMIT_RTPRIO, RLIMIT_NICE (-1 is no limit) and /proc/self/status."""
    capabilities = re.search(r"^CapEff:\s*([0-9a-f]+)$", status, re.MULTILINE)
    if capabilities and int(capabilities[1], 16) >> CAP_SYS_NICE & 1:
        rtprio = nice = -1
    highest = rtprio if rtprio >= 0 else 99
    lowest = min(20 - nice, 0) if nice >= 0 else -20
    return _judged(
        "real-time permission",
        "ok" if highest else "warning",
        f"real-time priority up to {highest}, nice down to {lowest}",
        "'USER - rtprio 98' and 'USER - nice -20' in /etc/security/limits.conf, then log in anew;"
        " in a container docker run --cap-add=sys_nice --ulimit rtprio=98",
    )


def processor(cores: int, quota: str) -> Finding:
    """Judge the cores a process may use, and a control group's cpu.max."""
    if cores < 2:
        mend = "two or more: taskset, docker run --cpuset-cpus, the virtual machine's settings"
        return Finding("cores", "problem", "1, for which all processes wait", mend)
    limited = re.match(r"(\d+) (\d+)", quota)
    if limited:
        found = f"{cores}, but all pause when {int(limited[1]) / int(limited[2]):g} are used up"
        return Finding("cores", "warning", found, "docker run --cpuset-cpus instead of --cpus")
    return Finding("cores", "ok", str(cores))


def load(mean: float, cores: int) -> Finding:
    """Judge how many threads ran, or waited to, on average of the last minute."""
    level: Level = "problem" if mean > cores else "warning" if mean > cores / 2 else "ok"
    found = f"{mean:.1f} over the last minute, on {cores} cores"
    return _judged("load", level, found, "end what else is running; top shows it")


def preemption(version: str, realtime: str) -> Finding:
    """Judge the kernel's preemption model, from ``uname -v`` and /sys/kernel/realtime."""
    models = ["PREEMPT_RT"] if realtime == "1" else re.findall(r"PREEMPT\w*", version)
    mend = "a kernel with PREEMPT_DYNAMIC, booted with preempt=full, or with PREEMPT_RT"
    found = models[0] if models else "not preemptible"
    return _judged("kernel", "ok" if models else "warning", found, mend)


def space(free: float) -> Finding:
    """Judge the room left in /dev/shm, MB."""
    mend = "sudo mount -o remount,size=256m /dev/shm; in a container docker run --shm-size=256m"
    level: Level = "ok" if free >= LITTLE_SHARED_MEMORY else "problem"
    return _judged("shared memory", level, f"{free:.0f} MB free in /dev/shm", mend)


def leftovers(folder: Path) -> Finding:
    """Look for Fast DDS segments of dead processes: those whose lock nobody holds.

    Only segments, whose names nobody takes again, so that trying the lock disturbs nobody.
    """
    pattern = re.compile(r"(fastrtps|fastdds)_[0-9a-z]{16}_el")
    locks = [path for path in folder.glob("fast*_el") if pattern.fullmatch(path.name)]
    left = [lock.with_name(lock.name[:-3]) for lock in locks if not _is_locked(lock)]
    size = sum(path.stat().st_size for path in left if path.exists()) / 1e6
    found = f"{len(left)} segments of dead processes in {folder}, {size:.1f} MB"
    mend = f"fastdds shm clean, or with no ROS program running rm {folder}/fast*_*"
    return _judged("leftovers", "warning" if left else "ok", found, mend)


def receive_buffer(rmem_max: str) -> Finding:
    """Judge net.core.rmem_max, the most that a socket may keep for a slow reader."""
    small = rmem_max and int(rmem_max) < LITTLE_RECEIVE_BUFFER
    found = f"net.core.rmem_max is {rmem_max or 'not to be seen'}"
    mend = f"if the graph spans machines: sudo sysctl -w net.core.rmem_max={4 << 20}"
    return _judged("receive buffer", "warning" if small else "ok", found, mend)


def sourced_ros(environment: Mapping[str, str], prefix: Path) -> Finding:
    """Tell whether a sourced ROS 2 is mixed with the one in a Python's own prefix."""
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
    mend = (
        "a shell in which no setup.bash was sourced, or env -u PYTHONPATH -u AMENT_PREFIX_PATH"
        " -u LD_LIBRARY_PATH -u RMW_IMPLEMENTATION haptic-accel ..."
    )
    return _judged("sourced ROS", "problem" if mixed else "ok", found, mend)


def executor(name: str) -> Finding:
    """Judge the executor that nodes run on."""
    mend = f"the events executor of ROS 2 Jazzy or newer, and no {EXECUTOR} in the environment"
    return _judged("executor", "ok" if "events" in name.lower() else "warning", name, mend)


def timer_slack(nanoseconds: str) -> Finding:
    """Judge by how much the kernel may wake a node late, which nodes set themselves."""
    much = nanoseconds and int(nanoseconds) > MUCH_TIMER_SLACK
    found = f"{nanoseconds} ns" if nanoseconds else "not to be seen"
    mend = "allow nodes prctl(PR_SET_TIMERSLACK), which a sandbox refuses"
    return _judged("timer slack", "warning" if much else "ok", found, mend)


def middleware(name: str) -> Finding:
    """Judge the middleware."""
    mend = "RMW_IMPLEMENTATION=rmw_fastrtps_cpp, which this package's profile is for"
    return _judged("middleware", "ok" if "fastrtps" in name else "warning", name, mend)


def profile(distribution: str, environment: Mapping[str, str], ours: Path) -> Finding:
    """Judge the file that Fast DDS reads; its version 3, from Kilted on, renamed the variable.

    Those in the folder `ours` are this package's.
    """
    product = "FASTRTPS" if distribution == "jazzy" else "FASTDDS"
    variable = f"{product}_DEFAULT_PROFILES_FILE"
    file = Path(environment[variable])
    if not file.is_file():
        return Finding("profile", "problem", f"{file}: no such file", f"unset {variable}")
    whose = (
        "this package's"
        if file.parent == ours
        else f"set by {variable} in place of this package's"
    )
    return Finding("profile", "ok", f"{file} ({whose})")


def discovery_range(environment: Mapping[str, str]) -> Finding:
    """Judge how far nodes look for each other."""
    name, variable = "discovery range", DISCOVERY_RANGE
    reach = environment[variable].upper() or "SUBNET"
    if reach == "LOCALHOST" or environment["ROS_LOCALHOST_ONLY"] == "1":
        found = "LOCALHOST: this machine, with shared memory, which can hold up publishing"
        return Finding(name, "warning", found, f"unset {variable} and ROS_LOCALHOST_ONLY")
    if reach == "SYSTEM_DEFAULT" and str(LOOPBACK_PROFILE) in environment.values():
        return Finding(name, "ok", "this machine, without shared memory")
    if reach == "OFF":
        return Finding(name, "problem", "OFF: no node finds another", f"unset {variable}")
    found = f"{reach}: nodes of other machines take part, and their traffic comes here"
    return Finding(name, "warning", found, f"unset {variable}, unless it is what you chose")


def domain(number: str) -> Finding:
    """Judge ROS_DOMAIN_ID."""
    high = number.isdecimal() and int(number) > HIGHEST_DOMAIN
    found = f"{number or 0}" + (", whose ports other programs may be using" if high else "")
    mend = f"a ROS_DOMAIN_ID up to {HIGHEST_DOMAIN}"
    return _judged("domain", "warning" if high else "ok", found, mend)


def other_graph(published: Sequence[str]) -> Finding:
    """Judge which of the graph's signals somebody publishes already."""
    found = f"publishes {', '.join(published)}" if published else "none in this domain"
    mend = "end it, or give this graph another ROS_DOMAIN_ID"
    return _judged("other graph", "problem" if published else "ok", found, mend)


def lateness(us: Mapping[str, float] | None) -> Finding:
    """Judge a timer's lateness, us: half a period is a late sample, a tenth is much."""
    name, mend = "wake-up lateness", "what is above; then what else runs here, or on a VM's host"
    if us is None:
        return Finding(name, "problem", "the timer never fired", mend)
    half, tenth = 0.5e6 / RATE, 0.1e6 / RATE
    level: Level = "problem" if us["p99_9"] > half else "warning" if us["p99"] > tenth else "ok"
    return _judged(name, level, _in_words(us), mend)


def age(us: Mapping[str, float] | None) -> Finding:
    """Judge a message's age after one hop, us: a tenth of a period is much."""
    if us is None:
        mend = "what is said of shared memory, profile and discovery; a firewall on loopback"
        return Finding("age after one hop", "problem", "no message came through", mend)
    level: Level = "warning" if us["p99"] > 0.1e6 / RATE else "ok"
    return _judged("age after one hop", level, _in_words(us), "as for wake-up lateness")


def measure(seconds: float) -> dict[str, Any]:
    """Run a process with a timer and one that listens to it; return what both found.

    Raises
    ------
    UnusableError
        One of them could not run.
    """
    with ExitStack() as stack:
        children = [_start(stack, role, seconds) for role in ("listener", "timer")]
        listener, timer = (_facts(child, seconds) for child in children)
    return {**timer, "age_us": listener["us"], "lateness_us": timer["us"]}


def reason(output: str) -> str:
    """Return the last error that a program wrote, in one line."""
    lines = output.strip().splitlines()
    errors = [i for i, line in enumerate(lines) if re.match(r"[\w.]*(Error|Exception)\b", line)]
    return " ".join(" ".join(lines[errors[-1] if errors else -1 :]).split())


def _start(stack: ExitStack, role: str, seconds: float) -> subprocess.Popen[str]:
    words = ["-m", "haptic_accel.cli.doctor", "--ros-args"]
    parameters = ["-p", f"role:={role}", "-p", f"seconds:={seconds:.3f}"]
    child = subprocess.Popen(
        [sys.executable, *words, *parameters],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        env={**os.environ, SUPERVISOR: str(os.getpid())},
    )
    stack.enter_context(child)
    stack.callback(child.kill)
    return child


def _facts(child: subprocess.Popen[str], seconds: float) -> dict[str, Any]:
    try:
        output, _ = child.communicate(timeout=seconds + PATIENCE)
    except subprocess.TimeoutExpired:
        raise UnusableError("a node did not come to its end") from None
    found = [line for line in output.splitlines() if line.startswith("{")]
    if not found:
        raise UnusableError(reason(output) or f"a node ended with status {child.returncode}")
    facts: dict[str, Any] = json.loads(found[-1])
    return facts


def _node() -> SupervisedNode:
    """Make the node of one of the two processes, which prints its facts and ends."""
    from haptic_accel.nodes import scheduling

    node = scheduling.SupervisedNode("doctor")
    role = node.declare_parameter("role", "timer").value
    seconds = node.declare_parameter("seconds", 5.0).value
    topic = replace(TOOL_ACCELERATION, name=f"doctor_{os.environ[SUPERVISOR]}/acceleration")
    durations = DurationHistogram()
    connected = (_listen if role == "listener" else _keep_time)(node, topic, durations)
    start = time.monotonic()
    end: float | None = None

    def look() -> None:
        nonlocal end
        now = time.monotonic()
        if end is None and (connected() or now > start + DISCOVERY):
            durations.reset()
            end = max(now + seconds, start + ANNOUNCEMENT)
        elif end is not None and now >= end and not node.finished.done():
            us = {label: round(durations.quantile(q) * 1e6, 1) for label, q in QUANTILES.items()}
            facts = {"us": us if durations.count else None, **_described(node)}
            print(json.dumps(facts), flush=True)
            node.finished.set_result(None)

    node.create_timer(LOOK_PERIOD, look)
    return node


def _listen(node: SupervisedNode, topic: Topic, ages: DurationHistogram) -> Callable[[], bool]:
    """Add the age of each message; return what tells whether any came."""
    from haptic_accel.nodes import interface

    message = interface.message_type(topic)

    def add(data: bytes) -> None:
        ages.add((time.time_ns() - unpack_stamped_vector(data)[0]) / 1e9)

    node.create_subscription(message, topic.name, add, interface.quality(topic), raw=True)
    return lambda: ages.count > 0


def _keep_time(
    node: SupervisedNode, topic: Topic, lateness: DurationHistogram
) -> Callable[[], bool]:
    """Add how long after the first moment not yet served a timer fires, and publish then.

    Returns what tells whether somebody listens.
    """
    from haptic_accel.nodes import interface, scheduling

    message = interface.message_type(topic)
    publisher = node.create_publisher(message, topic.name, interface.quality(topic))
    sender = interface.Sender(publisher, topic)
    keeper = scheduling.RateKeeper(RATE)
    keeper.lateness = lateness

    def tick() -> None:
        if keeper.tick() is not None:
            sender.send(time.time_ns(), ZERO)

    scheduling.start_timer(node, keeper, tick)
    return lambda: sender.listeners > 0


def _described(node: SupervisedNode) -> dict[str, Any]:
    """Return what a running node knows of its ROS 2 and of the domain it is in."""
    import rclpy

    from haptic_accel.nodes import scheduling

    wheels = [
        re.fullmatch(r"ros[-_](\w+)[-_]rclpy", d.name or "") for d in metadata.distributions()
    ]
    chosen = scheduling.EXECUTORS[os.environ.get(EXECUTOR, "events")]
    variables = (*VARIABLES, "ROS_DOMAIN_ID", "ROS_LOCALHOST_ONLY")
    return {
        "distribution": next((w[1] for w in wheels if w), os.environ.get("ROS_DISTRO", "")),
        "rclpy": f"{metadata.version('rclpy')} in {Path(rclpy.__file__).parent}",
        "executor": f"{chosen.__name__} of {chosen.__module__}",
        "middleware": rclpy.get_rmw_implementation_identifier(),
        "timer_slack": _text(Path("/proc/self/timerslack_ns")),
        "environment": {variable: os.environ.get(variable, "") for variable in variables},
        "published": [topic.name for topic in SIGNALS if node.count_publishers(topic.name)],
    }


def _judged(name: str, level: Level, found: str, mend: str) -> Finding:
    """Make a finding, which needs no mending where all is well."""
    return Finding(name, level, found, "" if level == "ok" else mend)


def _in_words(us: Mapping[str, float]) -> str:
    shown = ", ".join(f"{label.replace('_', '.')} {us[label]:.0f}" for label in QUANTILES)
    return f"{shown} us"


def _text(path: Path) -> str:
    """Return a file's text; empty where there is none to be read."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def _is_locked(path: Path) -> bool:
    try:
        with path.open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True  # or has gone, or belongs to another user, who knows better
    return False


def _table(findings: Sequence[Finding]) -> Table:
    table = Table("", "what", "found, and how to mend it", title="Real time on this machine")
    for finding in findings:
        colour = COLOURS[finding.level]
        mend = f"\n[bold]mend:[/bold] {escape(finding.mend)}" if finding.mend else ""
        level = f"[{colour}]{finding.level}[/{colour}]"
        table.add_row(level, finding.name, escape(finding.found) + mend)
    return table


def _write(file: Path, findings: Sequence[Finding], facts: Mapping[str, Any]) -> None:
    content = {
        "findings": [asdict(finding) for finding in findings],
        "lateness_us": facts.get("lateness_us"),
        "age_us": facts.get("age_us"),
    }
    try:
        file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"json = '{file}': {error.strerror}") from None


if __name__ == "__main__":
    from haptic_accel.nodes.scheduling import run

    run("doctor", _node)
