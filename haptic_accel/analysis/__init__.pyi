# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.analysis.description import (UNKNOWN as UNKNOWN, described as described,
    sections as sections)
from haptic_accel.analysis.frames import (bands as bands, compare as compare, csv_text as csv_text,
    groups as groups, load as load, signals as signals, spectra as spectra, trials as trials)
from haptic_accel.analysis.identification_result import pictures as pictures
from haptic_accel.analysis.description import page_provenance as page_provenance
