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

"""Page of a verb in the browser of this machine."""

from __future__ import annotations

import os
import sys
import webbrowser

from haptic_accel.cli.running import print_line

HOST = "127.0.0.1"
"""Address of the page: this machine alone."""


def show_page(address: str, *, opened: bool = True) -> None:
    """Print the address of a page, and open it in a browser where there is a screen."""
    print_line(f"{address} (Ctrl-C ends)")
    # Elsewhere a browser would be one of text, in this terminal.
    screens = map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    if opened and (sys.platform in ("darwin", "win32") or any(screens)):
        webbrowser.open(address)
