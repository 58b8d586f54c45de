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

"""The verb ``haptic-accel study``: its verbs and their summaries."""

from __future__ import annotations

from haptic_accel.commands import KitVerb, LazyGroup

GROUP = LazyGroup(
    "study",
    {
        "Before": {
            "new": "write a study from a template",
            "check": "check a study, and describe what it asks",
            "simulate": "run a study with simulated observers, and estimate its power",
        },
        "Participants": {
            "run": "run the session of a new participant",
            "resume": "go on with a session that was stopped or interrupted",
            "status": "show participants, progress and safety, without conditions",
            "verify": "compare logs with the journal and the notebook",
            "delete-participant": "delete a participant's log, bags and results",
        },
        "After": {
            "unblind": "let conditions be analysed, and log that and why",
            "analyze": "write the report with tables and figures",
            "export": "write the data as CSV, Psych-DS or BIDS",
        },
    },
    module="haptic_accel.kits.study.command_line",
    help="Plan, run and analyse studies with participants.",
    examples=[
        "haptic-accel study new --template compensated_or_not my_study",
        "haptic-accel study run my_study --participant P07",
    ],
)

VERB = KitVerb(
    "Studies with participants", "plan, run and analyse studies with participants", group=GROUP
)
