# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Safety of the handle: force, polarity, silence after a stop, and a pulled plug."""

from __future__ import annotations

import math
import time

import numpy as np

from haptic_accel.core import signal_checks as checks
from haptic_accel.core.model import ACTUATOR
from haptic_accel.core.signal_checks import Check
from haptic_accel.devices.observed import Force
from haptic_accel.kits.bringup.bench import MASTER, RESPONSE_SETTLING, SERIAL, SKIPPED, Bench
from haptic_accel.kits.bringup.boards import REST
from haptic_accel.setup.files import EVERY_NODE
from haptic_accel.setup.node_parameters import SAFETY
from haptic_accel.setup.rig_file import update_parameter_file

PROBE = 1.0
"""Duration of a probing force, s."""

METER_CURRENT = 0.1
"""Current through the resistor in the coil's place, A: a volt at ten ohms."""


def make_safe(bench: Bench) -> None:
    """Check force and polarity of the actuator, and its silence after each kind of end."""
    if not bench.has_actuator():
        return
    if bench.device_name(MASTER).endswith(SERIAL):
        _measure_current(bench)
    bench.goes_on("hold the handle as in use, with the coil connected, then press Enter")
    bench.settle(lambda: _probed(bench))
    bench.settle(lambda: _stopped(bench))
    if bench.device_name(MASTER).endswith(SERIAL):
        bench.settle(lambda: _unplugged(bench))


def _measure_current(bench: Bench) -> None:
    """Compare the amplifier's current through a resistor with the commanded current."""
    if not bench.goes_on(
        "disconnect the coil; put a resistor of 4 to 10 ohms and a meter for current in its"
        " place, then press Enter",
        skip="skip",
    ):
        bench.notes.append(f"{SKIPPED}current not measured")
        bench.person.tell(bench.notes[-1])
        return
    _, options = bench.parameters(MASTER)
    constant = options[SERIAL].actuator.force_constant

    def measure() -> list[Check]:
        with bench.observed(MASTER) as device:
            bench.person.show(device)
            device.drive(lambda _: METER_CURRENT * constant)
            time.sleep(RESPONSE_SETTLING)
            driven = bench.number("type the current that the meter shows now, A")
            device.drive(None)
            time.sleep(RESPONSE_SETTLING)
            silent = bench.number("the commands have ended: type the current now, A")
        zero = Check(
            abs(silent) < checks.CURRENT_ERROR * METER_CURRENT,
            f"current {silent:g} A without commands (0)",
            "switch the amplifier off: it does not follow the board",
        )
        return [checks.current_check(driven, METER_CURRENT), zero]

    bench.settle(measure)


def _probed(bench: Bench) -> list[Check]:
    """Check the response to forces; correct the polarity."""
    with bench.observed(MASTER) as device:
        bench.person.show(device)
        at_rest = device.observe(REST).acceleration
        noise = float(np.nanstd(at_rest)) * math.sqrt(2 / len(at_rest))
        responses = []
        for amplitude in checks.PROBE_FORCES:
            device.drive(_probe(amplitude))
            time.sleep(RESPONSE_SETTLING)
            seen = device.observe(PROBE)
            responses.append(checks.response(seen.force, seen.acceleration, seen.rate))
        device.drive(None)
    small, large = responses
    found = checks.probe_checks(small, large, noise)
    if len(found) > 1 and not found[1].passed:
        _, options = bench.parameters(MASTER)
        turned = -options[SAFETY].hardware.force_constant
        update_parameter_file(bench.path, {EVERY_NODE: {ACTUATOR: {"force_constant": turned}}})
        text = f"the coil pushes backwards: force constant made {turned:g} N/A"
        found[1] = Check(True, text)
    return found


def _stopped(bench: Bench) -> list[Check]:
    """Check that the handle is quiet after an emergency stop, and after the last command."""
    found = []
    with bench.observed(MASTER) as device:
        bench.person.show(device)
        noise = float(np.nanstd(device.observe(REST).acceleration))
        for name, end in (
            ("emergency stop", device.stop),
            ("end of the commands", lambda: device.drive(None)),
        ):
            device.arm()
            device.drive(_probe(checks.PROBE_FORCES[1]))
            time.sleep(RESPONSE_SETTLING)
            end()
            time.sleep(RESPONSE_SETTLING)
            seen = device.last(RESPONSE_SETTLING + REST)
            last = int(np.flatnonzero(seen.force)[-1])
            taken = checks.quiet_after(
                seen.acceleration - np.nanmean(seen.acceleration), seen.rate, last, noise
            )
            found.append(
                Check(
                    taken <= checks.QUIET_TIME,
                    f"quiet {1e3 * taken:.0f} ms after the {name} (at most"
                    f" {1e3 * checks.QUIET_TIME:.0f})",
                    "do not hold the handle: switch the amplifier off, and check its input",
                )
            )
    return found


def _unplugged(bench: Bench) -> list[Check]:
    """Check that a pulled plug is named, and that no force comes back by itself."""
    with bench.observed(MASTER) as device:
        bench.person.show(device)
        noise = float(np.nanstd(device.observe(REST).acceleration))
        device.drive(_probe(checks.PROBE_FORCES[1]))
        named = bench.awaits("pull the USB plug of the handle", lambda: bool(device.problem))
        lost = device.silent_for
        if not named:
            return [Check(False, "the plug was not pulled", "pull the USB plug while it hums")]
        gone = Check(
            lost <= checks.GONE_TIME,
            f"the loss was named after {lost:.2f} s (at most {checks.GONE_TIME:g})",
            "is the board on a hub that hides the loss? Use a port of this machine",
        )

        def is_gone() -> bool:
            return bool(np.isnan(device.last(RESPONSE_SETTLING).acceleration).all())

        def is_back() -> bool:
            return bool(np.isfinite(device.last(REST).acceleration).all())

        request = "plug it in again"
        if not (bench.awaits(request, is_gone) and bench.awaits("", is_back)):
            return [gone, Check(False, "the board did not come back", "reset the board")]
        level = float(np.nanstd(device.last(REST).acceleration))
    quiet = Check(
        level <= 2 * noise + checks.STILL,
        f"no force by itself once it is back ({level:.2f} m/s^2)",
        "flash the board: its firmware must wait to be armed",
    )
    return [gone, quiet]


def _probe(amplitude: float) -> Force:
    """Return the probing force of an amplitude in N."""
    omega = 2 * math.pi * checks.PROBE_FREQUENCY
    return lambda time: amplitude * math.cos(omega * time)
