"""The command ``haptic-accel``: its verbs and their arguments."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeAlias, TypeVar

from haptic_accel.core.controllers import CONTROLLERS
from haptic_accel.core.identification import DEFAULT_FREE, SweepParameters
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.startup.arguments import IdentifyArguments
from haptic_accel.startup.process import INTERRUPTED, WRONG_ARGUMENTS
from haptic_accel.tools import (
    bench,
    control,
    design,
    doctor,
    experiment,
    fidelity,
    identify,
    lockstep,
    soak,
    teleop,
)

T = TypeVar("T")
Verbs: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    arguments = _parser().parse_args(words)
    try:
        sys.exit(arguments.run(arguments))
    except ParameterError as error:
        print(f"haptic-accel: {error}", file=sys.stderr)
        sys.exit(WRONG_ARGUMENTS)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="haptic-accel", description="Feel what a remote tool touches."
    )
    verbs = parser.add_subparsers(title="verbs", required=True, metavar="VERB")
    _add_teleop(verbs)
    _add_control(verbs)
    _add_design(verbs)
    _add_experiment(verbs)
    _add_identify(verbs)
    _add_bench(verbs)
    _add_doctor(verbs)
    return parser


def _take_words(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("words", nargs="*", metavar="key:=value", help="arguments of the graph")


def _take_json(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")


def _add_teleop(verbs: Verbs) -> None:
    verb = verbs.add_parser(
        "teleop",
        help="run the teleoperation graph",
        description="Run the five nodes of the teleoperation graph until Ctrl-C.",
        epilog=teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _take_words(verb)
    verb.set_defaults(run=lambda arguments: teleop.teleop(arguments.words))


def _add_control(verbs: Verbs) -> None:
    verb = verbs.add_parser(
        "control",
        help="change the controller of a graph that runs",
        description="Let another controller take over, freeze or reset the adaptation, while the"
        " graph runs.",
        epilog=teleop.help_text(control.ControlArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _take_words(verb)
    verb.set_defaults(run=lambda arguments: control.control(arguments.words))


def _add_design(verbs: Verbs) -> None:
    verb = verbs.add_parser(
        "design",
        help="what inverse, feedback or adaptive will do, before anything runs",
        description="Design a controller for compensator.plant and print what it predicts: error,"
        " the least there can be, force, travel, gain and phase, and the feedback's margins.",
        epilog=teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _take_words(verb)
    _take_json(verb)
    verb.set_defaults(
        run=lambda arguments: design.design(arguments.words, json_file=arguments.json)
    )


def _add_experiment(verbs: Verbs) -> None:
    verb = verbs.add_parser(
        "experiment",
        help="run the paper's experiment and report Table II",
        description="Run the paper's three surfaces under its three controllers, print Table II"
        " beside the paper's, and write a report with its figures 9, 10 and 11.",
        epilog=f"surface and controller restrict the conditions; duration is that of one"
        f" condition (default here: {experiment.DURATION:g}).\n\n" + teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _take_words(verb)
    verb.add_argument(
        "--lockstep", action="store_true", help="without ROS, faster than real time, repeatable"
    )
    verb.add_argument(
        "--controllers",
        type=_words,
        default=experiment.PAPER_CONTROLLERS,
        metavar="NAME,NAME,...",
        help=f"of {', '.join(CONTROLLERS)} (default: {','.join(experiment.PAPER_CONTROLLERS)})",
    )
    for name in ("rig", "rate", "grip"):
        verb.add_argument(f"--{name}", metavar="VALUE", help=f"the same as {name}:=VALUE")
    verb.add_argument(
        "--recording", metavar="FILE", help="the same as surface:=recording recording:=FILE"
    )
    verb.add_argument("--recording-rate", metavar="HZ", help="the same as recording_rate:=HZ")
    verb.add_argument(
        "--seeds", type=int, default=1, help="users and pieces of material, each in lockstep"
    )
    _take_json(verb)
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of the report (default: results/<time>)"
    )
    verb.set_defaults(
        run=lambda arguments: experiment.experiment(
            [
                *arguments.words,
                *(["surface:=recording"] if arguments.recording else []),
                *_as_words(arguments, ["rig", "rate", "grip", "recording", "recording_rate"]),
            ],
            seeds=arguments.seeds,
            controllers=arguments.controllers,
            lockstep=arguments.lockstep,
            json_file=arguments.json,
            out=arguments.out,
        )
    )


def _add_identify(verbs: Verbs) -> None:
    verb = verbs.add_parser(
        "identify",
        help="find the handle's parameters with the paper's sweep",
        description="Excite the handle with the paper's sweep, fit its model, and write a"
        " parameter file for config:=FILE, with the paper's figures 4 and 5.",
        epilog=teleop.help_text(IdentifyArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _take_words(verb)
    verb.add_argument("--lockstep", action="store_true", help="without ROS, simulated handle")
    verb.add_argument(
        "--grips",
        type=_words,
        default=[],
        metavar="GRIP,GRIP,...",
        help="ways to hold the handle, one after the other, fitted one by one and pooled",
    )
    verb.add_argument(
        "--from",
        dest="sources",
        action="append",
        default=[],
        metavar="[GRIP=]FILE",
        help="evaluate a bag of an identification, or a CSV file with columns"
        f" {' and '.join(identify.COLUMNS)}, in place of a run; may be given many times",
    )
    verb.add_argument(
        "--recording-rate", type=float, default=0.0, metavar="HZ", help="of CSV files"
    )
    verb.add_argument(
        "--free",
        type=_words,
        default=list(DEFAULT_FREE),
        metavar="NAME,NAME,...",
        help=f"what is fitted (default: {','.join(DEFAULT_FREE)})",
    )
    shortened = {**schema(SweepParameters), "trials": schema(IdentifyArguments)["trials"]}
    shortened["rig"] = schema(IdentifyArguments)["rig"]
    for name in shortened:
        verb.add_argument(
            f"--{name.replace('_', '-')}", metavar="VALUE", help=f"the same as {name}:=VALUE"
        )
    _take_json(verb)
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of what is written (default: results/<time>)"
    )
    verb.set_defaults(
        run=lambda arguments: identify.identify(
            [*arguments.words, *_as_words(arguments, shortened)],
            lockstep=arguments.lockstep,
            grips=arguments.grips,
            sources=arguments.sources,
            recording_rate=arguments.recording_rate,
            free=arguments.free,
            json_file=arguments.json,
            out=arguments.out,
        )
    )


def _add_bench(verbs: Verbs) -> None:
    verb = verbs.add_parser("bench", help="measure the graph's latency, CPU and losses")
    kinds = verb.add_subparsers(title="kinds", required=True, metavar="KIND")
    latency = kinds.add_parser(
        "latency",
        help="one rate, beside rclpy's default executor and bare UDP",
        description="Run the whole graph as users do, the same on rclpy's default executor, and"
        " the same two hops as bare UDP, in turns; print ages, losses, CPU and memory.",
    )
    latency.add_argument("--rate", type=float, default=1000.0, help="Hz (default: 1000)")
    latency.add_argument("--pairs", type=int, default=1, help="graphs at a time (default: 1)")
    latency.set_defaults(
        run=lambda arguments: bench.bench_latency(
            arguments.words,
            rate=arguments.rate,
            seconds=arguments.seconds,
            pairs=arguments.pairs,
            json_file=arguments.json,
        )
    )
    sweep = kinds.add_parser(
        "sweep",
        help="ages and CPU against rate and number of pairs",
        description="Find the highest rate held with less than 0.1 % late, and draw ages and"
        " CPU against rate (500 Hz to 8 kHz) and against the number of pairs (1 to 8).",
    )
    sweep.add_argument(
        "--rates",
        type=_numbers(float),
        default=bench.SWEEP_RATES,
        metavar="HZ,HZ,...",
        help=f"for one pair (default: {_listed(bench.SWEEP_RATES)})",
    )
    sweep.add_argument(
        "--pairs",
        type=_numbers(int),
        default=bench.SWEEP_PAIRS,
        metavar="N,N,...",
        help=f"at 1 kHz (default: {_listed(bench.SWEEP_PAIRS)})",
    )
    sweep.add_argument("--out", type=Path, default=Path("results"), help="folder of the figure")
    sweep.set_defaults(
        run=lambda arguments: bench.bench_sweep(
            arguments.words,
            rates=arguments.rates,
            pairs=arguments.pairs,
            seconds=arguments.seconds,
            out=arguments.out,
            json_file=arguments.json,
        )
    )
    soaking = kinds.add_parser(
        "soak",
        help="whether memory stays flat",
        description="Run the graph with recording and watch the memory of its processes; exit"
        f" status 1 if one grows by more than {soak.MOST_GROWTH:g} MiB.",
    )
    soaking.set_defaults(
        run=lambda arguments: soak.bench_soak(
            arguments.words, seconds=arguments.seconds, json_file=arguments.json
        )
    )
    stepping = kinds.add_parser(
        "lockstep",
        help="how much faster than real time a trial without ROS is",
        description="Run one trial in lockstep on one core, and print how long it took.",
    )
    stepping.add_argument("--rate", type=float, default=1000.0, help="Hz (default: 1000)")
    stepping.set_defaults(
        run=lambda arguments: lockstep.bench_lockstep(
            arguments.words,
            rate=arguments.rate,
            seconds=arguments.seconds,
            json_file=arguments.json,
        )
    )
    _add_fidelity(kinds)
    for kind, seconds in ((latency, 20.0), (sweep, 5.0), (soaking, 600.0), (stepping, 10.0)):
        _take_words(kind)
        kind.add_argument(
            "--seconds",
            type=float,
            default=seconds,
            help=f"length of each measurement (default: {seconds:g})",
        )
        _take_json(kind)


def _words(text: str) -> list[str]:
    return text.split(",")


def _as_words(arguments: argparse.Namespace, names: Iterable[str]) -> list[str]:
    """Return options that have the meaning of an argument of the graph as such."""
    given = {name: getattr(arguments, name) for name in names}
    return [f"{name}:={value}" for name, value in given.items() if value is not None]


def _add_fidelity(kinds: Verbs) -> None:
    kind = kinds.add_parser(
        "fidelity",
        help="how well each controller does on every rig, grip and input, beside what can be done",
        description="Run all controllers in lockstep on both rigs, at 1 and 4 kHz, with Table I's"
        " grip, with many hands, and with grips that change; print errors beside the best that any"
        " causal linear filter could do.",
    )
    kind.add_argument(
        "--controllers",
        type=_words,
        default=list(CONTROLLERS),
        metavar="NAME,NAME,...",
        help=f"(default: {','.join(CONTROLLERS)})",
    )
    kind.add_argument(
        "--recording",
        action="append",
        default=[],
        metavar="FILE",
        help="CSV or WAV of a tool's acceleration, in place of the simulated surfaces; may be"
        " given many times",
    )
    kind.add_argument(
        "--recording-rate",
        action="append",
        type=float,
        default=[],
        metavar="HZ",
        help="of each CSV file, or once for all",
    )
    kind.add_argument("--hands", type=int, default=50, help="how many (default: 50)")
    kind.add_argument("--seed", type=int, default=1, help="that hands are drawn from (default: 1)")
    _take_json(kind)
    kind.set_defaults(
        run=lambda arguments: fidelity.bench_fidelity(
            controllers=arguments.controllers,
            recordings=arguments.recording,
            recording_rates=arguments.recording_rate,
            hands=arguments.hands,
            seed=arguments.seed,
            json_file=arguments.json,
        )
    )


def _numbers(kind: Callable[[str], T]) -> Callable[[str], list[T]]:
    """Return what reads numbers with commas between."""

    def numbers(text: str) -> list[T]:
        return [kind(word) for word in text.split(",")]

    return numbers


def _listed(numbers: Iterable[float]) -> str:
    return ",".join(f"{number:g}" for number in numbers)


def _add_doctor(verbs: Verbs) -> None:
    verb = verbs.add_parser(
        "doctor",
        help="what on this machine hurts real time, and how to mend it",
        description="Look for what hurts real time on this machine, say how to mend it, and"
        " measure how late a 1 kHz timer is. Changes nothing.",
    )
    verb.add_argument("--seconds", type=float, default=5.0, help="to measure (default: 5)")
    _take_json(verb)
    verb.set_defaults(run=lambda arguments: doctor.doctor(arguments.seconds, arguments.json))


if __name__ == "__main__":
    main()
