# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel analyze``: the paper's table, plots and a page from bags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from haptic_accel.bags.folder import find_bags
from haptic_accel.cli.options import FILE, jobs_option, json_option, out_option, verb


@verb(
    "haptic-accel analyze bags/",
    "haptic-accel analyze bags/ --compare controller:constant,inverse",
    "haptic-accel analyze monday tuesday --compare",
)
@click.argument("places", metavar="BAG...", type=FILE, nargs=-1, required=True)
@click.option(
    "--shift",
    default="granted",
    metavar="granted|paper|measured|MS",
    help="Time by which the actual acceleration is shifted back before it is compared: the latency"
    " and the controller's granted delay, one sample as in the paper, the delay measured in each"
    " trial, or milliseconds.",
)
@click.option(
    "--compare",
    "comparison",
    is_flag=False,
    flag_value="runs",
    metavar="controller:A,B",
    help="Test whether two controllers differ or, without a value, whether the two bags or folders"
    " given do; paired by trial.",
)
@click.option(
    "--no-perceptual",
    "perceptual",
    is_flag=True,
    flag_value=False,
    default=True,
    show_default=False,
    help="Leave out ST-SIM and SPQI, which take longest.",
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="Run each trial of simulated devices again in lockstep, and name the first sample at"
    " which the live one parts from it, with the reason.",
)
@click.option(
    "--rig",
    metavar="RIG",
    help="Virtual rig, ideal, paper or a .yaml file, whose handle stands for that of bags that do"
    " not describe their own, in the bounds of the error.",
)
@click.option(
    "--rate", type=float, metavar="HZ", help="Sampling rate of bags that do not state one, Hz."
)
@jobs_option
@json_option
@out_option
def analyze(
    places: Sequence[Path],
    *,
    shift: str,
    comparison: str | None,
    perceptual: bool,
    lockstep: bool,
    rig: str | None,
    rate: float | None,
    jobs: int,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Analyse bags, grouped by controller and surface.

    Takes any number of bags, or folders with bags. Prints Table II, and writes a page, plots
    for a paper, and tables.
    """
    for place in places:
        find_bags(place)
    # Its libraries take a second to import, for which a place without bags need not wait.
    from haptic_accel.cli.report import report

    report(
        places,
        shift,
        comparison,
        perceptual=perceptual,
        lockstep=lockstep,
        rig=rig,
        rate=rate,
        jobs=jobs,
        out=out,
        file=json_file,
    )
