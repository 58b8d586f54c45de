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
