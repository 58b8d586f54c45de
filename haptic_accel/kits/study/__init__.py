# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Studies with participants: protocol, trials, log, analysis and export.

A study is one YAML file, the `protocol`. `plan` makes the trials of a participant from the
protocol, `session` runs them on a rig with a participant, and `log` records all events. Rig and
participant are interfaces of `trials`: the live graph and a page, or simulated observers.
"""

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
