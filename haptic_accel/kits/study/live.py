# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rig of a study: the live graph, which presents the conditions in turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from haptic_accel import ChannelParameters, GraphArguments, graph, nodes, scope, setup
from haptic_accel.core import NO_CONTROLLER, RAMP
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.conditions import arguments, channel, live
from haptic_accel.kits.study.exposure import WeightedDose
from haptic_accel.kits.study.protocol import Condition, Protocol, Value
from haptic_accel.kits.study.trials import PresentedStimulus, StoppedError, UndeliveredError

NODE = "study"
"""Name of the node that follows the graph."""

SIGNALS = ("desired", "actual", "force", scope.SCENE)
"""Signals for the measures, and for the participant's page."""

STARTING_TIME = 60.0
"""Longest time from the start of a graph until its arms are engaged, s."""

SETTING, SETTLING = 0.2, scope.CONTROLLER_CHANGE_TIME + 0.05
"""Times from the request of a condition until all settings are made, and from then until the
fade-in, s. They are constant, so that they do not reveal the changed settings. Meanwhile filters
settle, and another reduction takes over."""

NETWORK_SETTLING = 2.0
"""Additional settling time with a network between the arms, s: buffers adapt to a new delay."""

LOOK_PERIOD, WEIGHING_PERIOD = 0.01, 0.5
"""Intervals between checks of the graph, and between additions to the exposure, s."""

COMPENSATOR = "compensator"


class LiveRig:
    """Live graph that presents conditions, and measures the delivered stimuli.

    If the controller is a factor, each stimulus starts with a reset controller. The graph's output
    is not shown, because it names conditions. Up to 100,000 samples of a stimulus are measured.

    Parameters
    ----------
    protocol : Protocol
    folder : Path
        Folder of the participant: ``graph.log``, and a bag for each start in ``bags``.

    Attributes
    ----------
    windows : Windows
        Latest signals for a page, while the context is entered.
    """

    windows: scope.Windows

    def __init__(self, protocol: Protocol, folder: Path) -> None:
        self._protocol, self._folder = protocol, folder
        self._context, self._network = ExitStack(), ExitStack()
        self._relay: graph.Relay | None = None
        self._joined: nodes.JoinedView
        self._view: nodes.GraphView
        self._graph: graph.BackgroundGraph | None = None
        self._arguments: GraphArguments
        self._bag = ""
        self._started = 0
        self._retried = self._stopped = False
        self._weighed: dict[str, int] = {}
        self._doses: dict[tuple[str, float], tuple[WeightedDose, float]] = {}

    def __enter__(self) -> LiveRig:
        """Start the graph with the first condition.

        Raises
        ------
        UndeliveredError
            The graph does not start.
        ParameterError
            Another graph runs in the namespace and ROS domain, or an argument is wrong.
        """
        first, _, network = self._needs(self._protocol.conditions[0])
        with ExitStack() as stack:
            stack.enter_context(graph.sole_graph(first.namespace))
            (self._folder / "bags").mkdir(parents=True, exist_ok=True)
            joined = nodes.open_joined_view(first.namespace, NODE, self._follow)
            self._joined = stack.enter_context(joined)
            stack.callback(self._close)
            self._start(first, network)
            self._context = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """End the graph."""
        self._context.close()

    # Rig of a session

    @property
    def exposure(self) -> float:
        """Frequency-weighted vibration dose of this sitting so far, m^2/s^3."""
        return float(sum(dose.dose for dose, _ in self._doses.values()))

    def present(
        self, condition: Condition, seconds: float, begun: Callable[[], None] = lambda: None
    ) -> PresentedStimulus:
        """Present a condition with a faded beginning and end; see `trials.Rig`."""
        try:
            requested, settings, network = self._needs(condition)
            self._restart(requested, network)
            presented = self._present(settings, network, seconds, begun)
        except (nodes.RequestError, graph.RelayError, ParameterError) as error:
            self._check()  # if the graph has ended, that is the reason
            raise UndeliveredError(str(error)) from None
        self._retried = False
        return presented

    def stop(self) -> None:
        """Set all forces to zero, from any thread; no stimulus is presented afterwards."""
        self._stopped = True
        if self._graph:
            self._graph.stop_forces()

    # Source of the participant's page

    def scene(self) -> dict[str, Any]:
        """Return the drawing of the scene."""
        return self._view.scene()

    def lead(self, x: float, z: float) -> str:
        """Lead the simulated hand to a point, m; return the reason of a refusal."""
        return self._view.lead(x, z)

    @property
    def has_pointer(self) -> bool:
        """True if a page can lead the hand."""
        return self._view.has_pointer

    # The graph

    def _follow(self, view: nodes.GraphView) -> None:
        self._view, self.windows = view, view.windows
        view.receive(SIGNALS)
        view.create_timer(WEIGHING_PERIOD, self._weigh)

    def _needs(
        self, condition: Condition
    ) -> tuple[GraphArguments, dict[str, Value], ChannelParameters | None]:
        """Return start arguments, live settings and network of a condition's graph."""
        requested, settings = arguments(self._protocol, condition), live(self._protocol, condition)
        if "network" not in settings:
            return requested, settings, None
        if "surface" in settings:  # the slave's side is reached only through the network
            requested = replace(requested, surface=str(settings.pop("surface")))
        return requested, settings, channel(settings["network"])

    def _restart(self, requested: GraphArguments, network: ChannelParameters | None) -> None:
        """Start the graph again if it has ended or has other arguments."""
        ended = self._graph.ended if self._graph else ""
        same = requested == self._arguments and (network is None) == (self._relay is None)
        if self._graph and not ended and same:
            return
        if ended and self._retried:
            raise StoppedError(f"{ended}, twice; see {self._folder / 'graph.log'}")
        self._retried = bool(ended)
        self._close()
        self._start(requested, network)

    def _start(self, requested: GraphArguments, network: ChannelParameters | None) -> None:
        bags = self._folder / "bags"
        bag = bags / f"{len(list(bags.iterdir())):03d}"
        self._bag = str(bag.relative_to(self._folder))
        self._arguments = requested
        asked = replace(requested, bag=str(bag), record=True, scope=False)
        if network is None:
            processes = setup.graph(asked)
        else:
            sides = self._network.enter_context(graph.networked_graph(asked, network))
            processes, self._relay = sides.processes, sides.relay
        for process in processes:
            if COMPENSATOR in process.parameters:
                process.parameters[COMPENSATOR]["gain"] = 0.0  # until the first stimulus
        self._view.forget()
        self._started = time.time_ns()
        self._graph = graph.BackgroundGraph(processes, self._folder / "graph.log")
        self._await_arms()

    def _close(self) -> None:
        if self._graph:
            self._graph.close()
        self._graph = self._relay = None
        self._network.close()

    def _await_arms(self) -> None:
        """Wait until the arms are engaged, also after a disengagement."""
        if not self._wait(STARTING_TIME, self._is_ready):
            raise UndeliveredError(f"graph: its arms are not engaged after {STARTING_TIME:g} s")

    def _is_ready(self) -> bool:
        """Return true if the arms of the present graph are engaged, and its signals arrive."""
        values = self._view.reports.values("coupler", time.monotonic())
        rings = self.windows.handle, self.windows.desired
        return (
            values.get("engaged") == "true"
            and not self.windows.settings.assumed
            and all(ring.newest > self._started for ring in rings)
        )

    def _wait(self, seconds: float, condition: Callable[[], bool] = lambda: False) -> bool:
        """Wait for a condition; return whether it was met in time."""
        due = time.monotonic() + seconds
        while not condition():
            self._check()
            left = due - time.monotonic()
            if left <= 0.0:
                return False
            time.sleep(min(left, LOOK_PERIOD))
        return True

    def _check(self) -> None:
        if self._stopped:
            raise StoppedError("stopped: all forces are off")
        if any(self._view.emergency_stop.values()):
            raise StoppedError("emergency stop")
        if self._graph and (ended := self._graph.ended):
            raise UndeliveredError(f"{ended}; see {self._folder / 'graph.log'}")

    def _check_recorder(self) -> None:
        """Refuse a stimulus that the bag may lack, for example because the disk is full."""
        bad = scope.LEVELS[1], scope.LEVELS[2]
        for row in self._view.reports.rows(time.monotonic(), ()):
            if row["name"] == setup.RECORDER and row["state"] in bad:
                raise UndeliveredError(f"{setup.RECORDER}: {row['message']}")

    # A stimulus

    def _present(
        self,
        settings: Mapping[str, Value],
        network: ChannelParameters | None,
        seconds: float,
        begun: Callable[[], None],
    ) -> PresentedStimulus:
        settling = SETTLING + (NETWORK_SETTLING if network else 0.0)
        due = time.monotonic() + SETTING + settling
        gain = float(settings.get("gain", 1.0))
        makers = nodes.SETTINGS.items()
        changes = [make(settings[name]) for name, make in makers if name in settings]
        if "controller" in settings:  # otherwise an unchanged controller would keep its adaptation
            self._joined.send(nodes.set_controller(NO_CONTROLLER))
        self._joined.change(changes)
        if network and self._relay:
            self._relay.reconnect(network)
        before = self._joined.force_counts("master_device")
        self._wait(max(settling, due - time.monotonic()))
        self._await_arms()
        begun()
        try:
            self._joined.change([nodes.set_gain(gain)])
            self._wait(RAMP)
            begin = time.time_ns()
            self._wait(seconds)
            end = time.time_ns()
        finally:
            if self._graph and not self._graph.ended:
                self._joined.change([nodes.set_gain(0.0)])
        self._wait(RAMP + scope.INTERVAL_MARGIN)
        after = self._joined.force_counts("master_device")
        self._joined.check(changes)
        self._check_recorder()
        has: dict[str, Value] = {**settings, "gain": gain}
        reported = self._view.reports.values(COMPENSATOR, time.monotonic())
        if (substitute := reported.get("replaced by", "-")) != "-":
            has["replaced by"] = substitute
        late = scope.late_percent(before, after, self._arguments.rate)
        found = scope.measure(self.windows, begin, end, self._arguments.rate)
        if found is None:
            raise UndeliveredError("no samples of the handle's acceleration")
        return PresentedStimulus(**vars(found), bag=self._bag, late=late, read_back=has)

    def _weigh(self) -> None:
        """Add the newest samples to the exposure; called on the view's thread."""
        for axis, windows in self.windows.by_axis.items():
            count, _, values = windows.handle.since(self._weighed.get(axis, 0))
            self._weighed[axis] = count
            if len(values):
                rate = self._arguments.rate
                new = WeightedDose(rate), float(values[0])  # gravity is subtracted
                dose, rest = self._doses.setdefault((axis, rate), new)
                dose.add(values - rest)
