# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Models of textures: built from recordings, imported, shown and rendered."""

from haptic_accel import lazy_names
from haptic_accel.commands import KitVerb, LazyGroup

GROUP = LazyGroup(
    "texture",
    {
        "Verbs": {
            "build": "build a model from recordings with speed, force and acceleration",
            "import": "make a model of another program's file",
            "show": "show a model's range and spectra",
            "render": "write a model's acceleration as a sound file",
        }
    },
    module="haptic_accel.kits.textures.command_line",
    help="Build, import, show and render models of textures.",
    examples=[
        "haptic-accel texture build drag.csv --rate 10000 --out wood.yaml",
        "haptic-accel texture render plywood --speed 80 --force 1 --out wood.wav",
    ],
)

__getattr__, __dir__ = lazy_names(__name__, __file__)

VERB = KitVerb("Surfaces", "build, import, show and render models of textures", group=GROUP)
