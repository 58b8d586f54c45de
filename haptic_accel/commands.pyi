# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.cli.commands import KitVerb as KitVerb, LazyGroup as LazyGroup
from haptic_accel.cli.main import run as run
from haptic_accel.cli.options import (FILE as FILE, Verb as Verb, arguments as arguments,
    json_option as json_option, listed_words as listed_words, one_of as one_of, verb as verb,
    words as words, workers_options as workers_options)
from haptic_accel.cli.output import (StoppedError as StoppedError,
    check_writable as check_writable, make_folder as make_folder, next_command as next_command,
    save as save)
from haptic_accel.cli.running import (STOP_KEY as STOP_KEY,
    interrupted_by_signals as interrupted_by_signals, is_ours as is_ours, on_keys as on_keys,
    print_line as print_line, progress_bar as progress_bar, show_page as show_page,
    stop_on_signal as stop_on_signal)
from haptic_accel.cli.studies import run_side_by_side as run_side_by_side
from haptic_accel.cli.tables import print_table as print_table
from haptic_accel.cli.workers import Workers as Workers
from haptic_accel.core.process import DONE as DONE, FAILED as FAILED
from haptic_accel.core.tables import Column as Column, ResultTable as ResultTable, Row as Row
