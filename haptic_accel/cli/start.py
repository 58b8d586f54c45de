# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry point of the script ``haptic-accel``, which Ctrl-C ends silently from the start.

The module imports only what the signal's handler needs.
"""

from __future__ import annotations

import os
import signal

from haptic_accel.core.process import INTERRUPTED


def main() -> None:
    """Run the command line of this process and exit."""
    # Keep the signal ignored in a script's background job.
    handled = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if handled:
        # Python's handler would print a traceback of an import, and there is nothing to undo.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    from haptic_accel.cli.main import main as run

    try:
        if handled:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:
        os._exit(INTERRUPTED)
    finally:
        # Python would also print a traceback for a signal at exit.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
