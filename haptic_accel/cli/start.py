# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry point of the script ``haptic-accel``, which Ctrl-C ends quietly from its first line on.

It imports nothing but what the handling of the signal needs.
"""

from __future__ import annotations

import os
import signal

from haptic_accel.core.process import INTERRUPTED


def main() -> None:
    """Run the command line of this process and exit."""
    # A job in the background of a script ignores the signal.
    handled = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if handled:
        # Python's handler would print the traceback of an import. There is nothing to undo.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    from haptic_accel.cli.main import main as run

    try:
        if handled:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:
        os._exit(INTERRUPTED)
    finally:
        # Python's exit would print a traceback, too.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
