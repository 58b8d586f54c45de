# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command `haptic-accel`: its subcommands, in groups whose code is imported on demand."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

import click

from haptic_accel import __version__
from haptic_accel.cli.output import StoppedError
from haptic_accel.core.outside import OutsideError, declared, guard, load
from haptic_accel.core.parameters import suggestion, warn_once
from haptic_accel.core.process import WRONG_ARGUMENTS

COMMANDS_GROUP = "haptic_accel.commands"
"""Group of entry points for the subcommands of kits, in this package and others."""


@dataclass(frozen=True)
class KitVerb:
    """Subcommand of a kit, named by an entry point.

    Parameters
    ----------
    heading : str
        Heading of its section in the help text.
    summary : str
        Line of the help text.
    module : str
        Module with the command's function, imported when the command is used.
    group : LazyGroup, optional
        Group of further subcommands; the module is then not needed.
    """

    heading: str
    summary: str
    module: str = ""
    group: LazyGroup | None = None


class LazyGroup(click.Group):
    """Group of subcommands under headings, each imported when used.

    An emergency stop must wait neither for the import of plotting libraries nor for a search for
    other packages.

    Parameters
    ----------
    name : str
    sections : mapping
        Summaries of the subcommands, by heading and name.
    module : str
        Module or package of the subcommands. In a package, a subcommand is in the module named
        after the group or, if missing there, in the module of the subcommand's own name.
    homes : mapping
        Names of modules in the package, by subcommands that have none of their own name.
    groups : sequence of click.Group
        Subcommands that are groups themselves.
    entry_points : str
        Group of entry points with further subcommands (`KitVerb`); empty for none.
    moved : mapping
        Command that replaces a former subcommand, by the former name.
    examples : sequence of str
        Command lines for the help text.
    """

    def __init__(
        self,
        name: str,
        sections: Mapping[str, Mapping[str, str]],
        *,
        module: str = "haptic_accel.cli",
        homes: Mapping[str, str] = MappingProxyType({}),
        groups: Sequence[click.Group] = (),
        entry_points: str = "",
        moved: Mapping[str, str] = MappingProxyType({}),
        examples: Sequence[str] = (),
        **settings: Any,
    ) -> None:
        super().__init__(name, no_args_is_help=False, subcommand_metavar="VERB ...", **settings)
        self._own = sections
        self._names = [name for commands in sections.values() for name in commands]
        self._own_groups = {group.name or "": group for group in groups}
        self._module, self._homes = module, homes
        self._entry_points = entry_points
        self._moved = moved
        self.examples = examples

    @cached_property
    def kits(self) -> Mapping[str, KitVerb]:
        """Subcommands of kits by name; names of this group's own subcommands are excluded."""
        return _kit_verbs(self._entry_points, self._names) if self._entry_points else {}

    @cached_property
    def sections(self) -> Mapping[str, Mapping[str, str]]:
        """Summaries of all subcommands, by heading and name."""
        found = {heading: dict(commands) for heading, commands in self._own.items()}
        for name, kit in self.kits.items():
            found.setdefault(kit.heading, {})[name] = kit.summary
        return {heading: commands for heading, commands in found.items() if commands}

    @property
    def verbs(self) -> list[str]:
        """Names of all subcommands, in the order of their headings."""
        return [command for verbs in self.sections.values() for command in verbs]

    @cached_property
    def groups(self) -> Mapping[str, click.Group]:
        """Subcommands that are groups themselves, by name."""
        of_kits = {name: kit.group for name, kit in self.kits.items() if kit.group}
        return of_kits | self._own_groups

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Print the help if the subcommand is missing, as an error (as click 8.2 does)."""
        if not args and not ctx.resilient_parsing:
            click.echo(ctx.get_help(), err=True)
            ctx.exit(WRONG_ARGUMENTS)
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the subcommands in the order of their headings."""
        return self.verbs

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a subcommand."""
        if cmd_name in self._names:
            return self._own_groups.get(cmd_name) or self._imported(self._module, cmd_name)
        if kit := self.kits.get(cmd_name):
            return kit.group or self._imported(kit.module, cmd_name)
        return None

    def _imported(self, module: str, command: str) -> click.Command:
        """Return a subcommand from a module, or from a package of modules."""
        try:
            with guard(module):
                modules = [import_module(module)]
                if hasattr(modules[0], "__path__"):
                    names = (self.name, self._homes.get(command, command))
                    within = (f"{module}.{name}" for name in names)
                    modules = [import_module(each) for each in within if find_spec(each)]
                for each in (each for here in modules for each in vars(here).values()):
                    if isinstance(each, click.Command) and each.name == command:
                        return each
        except OutsideError as error:
            raise StoppedError(f"{command}: {error}") from None
        raise StoppedError(f"{command}: {module} has no click command of this name")

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the subcommand of a command line, or name the nearest one."""
        word = args[0]
        is_known = word in self._names or word in self.kits
        if is_known or word.startswith("-") or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        if word in self._moved:
            ctx.fail(f"{word}: is now {self._moved[word]}")
        near = suggestion(word, self.verbs)
        ctx.fail(f"{word}: no such verb{near}; there are {', '.join(self.verbs)}")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the summaries of the subcommands without importing any."""
        for heading, commands in self.sections.items():
            with formatter.section(heading):
                formatter.write_dl(list(commands.items()))

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        write_examples(formatter, self.examples)


def _kit_verbs(group: str, own: Collection[str]) -> dict[str, KitVerb]:
    """Return the subcommands of a group of entry points, sorted by name.

    An entry that is no subcommand, or whose package cannot be imported, is omitted with a warning,
    so that the other subcommands remain usable.
    """
    found: dict[str, KitVerb] = {}
    for name, entry in declared(group, own).items():
        try:
            found[name] = load(entry, _verb_problem)
        except OutsideError as error:
            warn_once(f"haptic-accel: {name}: {error}")
    return found


def _verb_problem(command: Any) -> str:
    """Return the reason to refuse a loaded object as a subcommand; empty if there is none."""
    if not isinstance(command, KitVerb):
        return "must be a KitVerb"
    texts = (command.heading, command.summary, command.module)
    if not (all(isinstance(each, str) for each in texts) and texts[0]):
        return "heading, summary and module must be text"
    return "" if isinstance(command.group, LazyGroup | None) else "group must be a LazyGroup"


def write_examples(formatter: click.HelpFormatter, examples: Sequence[str]) -> None:
    """Write command lines as they are typed, one per line."""
    if examples:
        with formatter.section("Examples"):
            for example in examples:
                formatter.write(f"{'':{formatter.current_indent}}{example}\n")


BAG = LazyGroup(
    "bag",
    {
        "Verbs": {
            "info": "show topics, recording settings and damage of a bag",
            "repair": "repair bags whose recording was cut off",
        }
    },
    help="Inspect bags, and repair those whose recording was cut off.",
    examples=["haptic-accel bag info bags/text", "haptic-accel bag repair bags/*"],
)
BENCH = LazyGroup(
    "bench",
    {"Kinds": {"latency": "latency, losses and CPU of the graph, beside two references"}},
    help="Measure latency, CPU and losses of the graph on this machine.",
    moved={
        "fidelity": "python benchmarks/fidelity.py in the source",
        "network": "python benchmarks/coupling_over_networks.py in the source",
    },
    examples=["haptic-accel bench latency rig:=ideal --rate 2000"],
)

SECTIONS = {
    "First touch": {"touch": "touch a surface on a page, without ROS or hardware"},
    "Graph": {
        "teleop": "run the teleoperation graph",
        "control": "change controller, surface or grip of a running graph",
        "estop": "stop a running graph in an emergency, or release it",
        "scope": "serve a page that shows a running graph",
    },
    "Devices": {"calibrate": "measure gain and offset of an accelerometer by gravity"},
    "Recording and analysis": {
        "record": "start, pause, split or stop the recording of a running graph",
        "bag": "inspect and repair bags",
        "replay": "play a bag again, with any controller",
        "analyze": "write the paper's tables and plots from bags",
        "experiment": "run the paper's experiment and report Table II",
    },
    "Studies with participants": {},
    "Design": {
        "identify": "fit the handle's model with the paper's sweep",
        "design": "predict error, force and margins of a controller",
    },
    "Surfaces": {},
    "Machine": {
        "bench": "measure latency, CPU and losses of the graph",
        "doctor": "find causes of timing jitter on this machine; audio: try a sound card",
    },
}
"""Summaries of subcommands by heading; kits add subcommands to the empty headings."""

command_line = LazyGroup(
    "haptic-accel",
    SECTIONS,
    homes={"record": "control", "scope": "live", "teleop": "live", "touch": "live"},
    groups=[BAG, BENCH],
    entry_points=COMMANDS_GROUP,
    help="Haptic teleoperation with acceleration feedback: feel what a remote tool touches.",
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "show_default": True,
    },
    examples=[
        "haptic-accel teleop controller:=dynamic surface:=text",
        "haptic-accel experiment --lockstep",
        "haptic-accel VERB --help",
    ],
)
click.version_option(__version__, message="%(prog)s %(version)s")(command_line)
