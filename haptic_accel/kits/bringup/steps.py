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

"""Five steps from unknown boards to a compensated handle: each measures, judges and advises."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

from haptic_accel.devices import DeviceError
from haptic_accel.kits.bringup.bench import STEPS, Bench, BringUpArguments, BringUpError, Person
from haptic_accel.kits.bringup.boards import calibrate_boards, connect
from haptic_accel.kits.bringup.compensation import identify, prove
from haptic_accel.kits.bringup.handle_safety import make_safe
from haptic_accel.setup.rig_file import note_step, noted_steps, teleoperation_words

_FUNCTIONS: dict[str, Callable[[Bench], None]] = {
    "connect": connect,
    "calibrate": calibrate_boards,
    "make_safe": make_safe,
    "identify": identify,
    "prove": prove,
}


class BringUp:
    """Bring-up of a rig.

    Parameters
    ----------
    arguments : BringUpArguments
    person : Person

    Raises
    ------
    ParameterError
        The rig's file cannot be read or written, or an argument does not go with it.
    """

    def __init__(self, arguments: BringUpArguments, person: Person) -> None:
        self._bench = Bench(arguments, person)
        noted = noted_steps(self._bench.path)
        self._done = dict[str, str]()
        for step in STEPS:
            if step not in noted or step == arguments.redo:
                break
            self._done[step] = noted[step]

    def run(self) -> list[str]:
        """Take the steps that are left; return verb and words of the next command.

        Raises
        ------
        BringUpError
            A step cannot be taken.
        EOFError
            Nobody answers; the same command goes on at the unfinished step.
        """
        bench = self._bench
        for number, (step, purpose) in enumerate(STEPS.items(), start=1):
            bench.person.begin(number, step.replace("_", " "), purpose)
            if step in self._done:
                bench.person.tell(f"done {self._done[step]}")
                continue
            bench.notes.clear()
            try:
                _FUNCTIONS[step](bench)
            except DeviceError as error:
                raise BringUpError(str(error)) from None
            bench.person.show(None)
            text = "; ".join(bench.notes) or "nothing to do"
            note_step(bench.path, step, f"{datetime.now():%Y-%m-%d %H:%M}: {text}")
        return teleoperation_words("", bench.path, "controller:=adaptive")
