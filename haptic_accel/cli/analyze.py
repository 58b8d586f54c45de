# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel analyze``: the paper's table, plots and a page from bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_accel.bags.folder import find_bags
from haptic_accel.cli.options import FILE, json_option, out_option, verb, workers_options
from haptic_accel.cli.output import StoppedError, results_folder, save
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import INTERRUPTED

if TYPE_CHECKING:
    from haptic_accel.cli.workers import Workers


@verb(
    "haptic-accel analyze bags/",
    "haptic-accel analyze bags/ --compare controller:constant,inverse",
    "haptic-accel analyze monday tuesday --compare",
)
@click.argument("paths", metavar="BAG...", type=FILE, nargs=-1, required=True)
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
    help="Test the difference between two controllers or, without a value, between the two given"
    " bags or folders; trials are paired.",
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="Repeat each trial of simulated devices in lockstep, and print the first sample at"
    " which the live trial differs, with the reason.",
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
@workers_options
@json_option
@out_option
def analyze(
    paths: Sequence[Path],
    *,
    shift: str,
    comparison: str | None,
    lockstep: bool,
    rig: str | None,
    rate: float | None,
    workers: Workers,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Analyse bags, grouped by controller and surface.

    Takes any number of bags, or folders with bags. Prints Table II, and writes a page, plots
    for a paper, and tables.
    """
    bags = [bag for path in paths for bag in find_bags(path)]
    # Imported after the search for bags, as the libraries take a second to load.
    from haptic_accel.analysis.frames import RUNS, check_comparison, compared
    from haptic_accel.analysis.loading import analyse
    from haptic_accel.analysis.metrics import Shift
    from haptic_accel.analysis.writing import as_json, write_analysis
    from haptic_accel.bags.reading import read_bag
    from haptic_accel.cli.report import divergences, print_analysis, print_trials
    from haptic_accel.cli.running import stop_on_signal
    from haptic_accel.setup.arguments import GraphArguments
    from haptic_accel.setup.setup import Setup

    chosen = Shift.read(shift)
    if comparison:
        check_comparison(comparison, paths)
    parameters = Setup.of(GraphArguments(rig=rig)).rig() if rig else None
    folder = results_folder(out)
    with stop_on_signal() as stop:
        spread = partial(workers.map, stop=stop)
        try:
            analysis = analyse(
                paths,
                chosen,
                rig=parameters,
                rate=rate,
                apart=comparison == RUNS,
                spread=spread,
                ended=print_trials,
            )
            if not analysis.trials and len(bags) == 1:
                read_bag(bags[0])  # raises the reason why it cannot be read
        except ParameterError:
            folder.rmdir()
            raise
        parted = list(divergences(analysis, spread)) if lockstep else []
        interrupted = stop()
    found = compared(analysis, comparison, paths) if comparison else None
    page = write_analysis(analysis, folder, found)
    content = as_json(analysis, found)
    if lockstep:
        content["lockstep"] = [asdict(each) | {"bag": str(each.bag)} for each in parted]
    save(content, json_file)
    print_analysis(analysis, found, *(each.sentence for each in parted), f"report: {page}")
    if interrupted:
        raise StoppedError(f"interrupted after {analysis.bags} bags", INTERRUPTED)
    if analysis.failed or not analysis.trials:
        raise StoppedError
