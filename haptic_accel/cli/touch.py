# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel touch``: page to touch surfaces through the simulated rig, without ROS."""

from __future__ import annotations

import click

from haptic_accel.cli.options import verb
from haptic_accel.cli.running import show_page, stop_on_signal
from haptic_accel.scope.access import LOCAL_HOST, Access
from haptic_accel.scope.paced_rig import PacedRig
from haptic_accel.scope.server import ScopeServer


@verb("haptic-accel touch", "haptic-accel touch --surface text --rig ideal")
@click.option("--surface", default="plywood", metavar="NAME|FILE", help="Surface at the start.")
@click.option("--rig", default="paper", metavar="NAME|FILE", help="Virtual rig.")
@click.option(
    "--port", default=0, metavar="PORT", type=click.IntRange(0, 65535), help="TCP port; 0 for any."
)
@click.option("--open/--no-open", "opened", default=True, help="Open the page in a browser.")
def touch(surface: str, rig: str, port: int, opened: bool) -> None:
    """Touch a surface on a page with mouse, finger or arrow keys until Ctrl-C.

    The page shows and plays what the handle does without compensation, with the paper's and with
    this package's. The rig is simulated in this process, by the loop of the live graph, and needs
    no ROS.
    """
    touched = PacedRig(surface, rig)
    server = ScopeServer(touched, Access(LOCAL_HOST, ""), LOCAL_HOST, port, touched.act)
    with stop_on_signal() as stop:
        show_page(server.start(), opened=opened)
        touched.run(stop)
    server.stop()
