"""The arguments of ``haptic-accel bench``."""

from __future__ import annotations

from pathlib import Path

from haptic_accel.cli import bench, fidelity, lockstep, protocol_bench, soak, watched
from haptic_accel.cli.commands.options import (
    Verbs,
    listed,
    listed_words,
    numbers,
    take_json,
    take_words,
)
from haptic_accel.core.control.controllers import CONTROLLERS


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser("bench", help=summary)
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
        type=numbers(float),
        default=bench.SWEEP_RATES,
        metavar="HZ,HZ,...",
        help=f"for one pair (default: {listed(bench.SWEEP_RATES)})",
    )
    sweep.add_argument(
        "--pairs",
        type=numbers(int),
        default=bench.SWEEP_PAIRS,
        metavar="N,N,...",
        help=f"at 1 kHz (default: {listed(bench.SWEEP_PAIRS)})",
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
    watching = kinds.add_parser(
        "scope",
        help="what the live scope costs the graph that it shows",
        description="Run the graph without and with a scope that is looked at, in turns; print"
        " the age of the forces and the CPU of both, and what the scope sends.",
    )
    take_words(watching)
    watching.add_argument("--seconds", type=float, default=20.0, help="of each run (default: 20)")
    watching.add_argument("--rounds", type=int, default=2, help="of both (default: 2)")
    watching.add_argument(
        "--browser",
        default="",
        metavar="PROGRAM",
        help="a Chromium to look with (default: one who takes the frames and draws nothing)",
    )
    take_json(watching)
    watching.set_defaults(
        run=lambda arguments: watched.bench_scope(
            arguments.words,
            seconds=arguments.seconds,
            rounds=arguments.rounds,
            browser=arguments.browser,
            json_file=arguments.json,
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
    protocol = kinds.add_parser(
        "protocol",
        help="many generated frames through the serial protocol",
        description="Send generated frames, a tenth of them spoiled, through decoder and board of"
        " the serial protocol; exit status 1 if one is missed, or a current flows that must not.",
    )
    protocol.add_argument("--frames", type=int, default=100_000, help="(default: 100000)")
    protocol.add_argument("--seed", type=int, default=1, help="(default: 1)")
    take_json(protocol)
    protocol.set_defaults(
        run=lambda arguments: protocol_bench.bench_protocol(
            frames=arguments.frames, seed=arguments.seed, json_file=arguments.json
        )
    )
    for kind, seconds in ((latency, 20.0), (sweep, 5.0), (soaking, 600.0), (stepping, 10.0)):
        take_words(kind)
        kind.add_argument(
            "--seconds",
            type=float,
            default=seconds,
            help=f"length of each measurement (default: {seconds:g})",
        )
        take_json(kind)


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
        type=listed_words,
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
    take_json(kind)
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
