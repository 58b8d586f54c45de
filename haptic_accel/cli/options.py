# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Declarations shared by commands: ``key:=value`` arguments, options, and their help."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, cast

import click
from click.shell_completion import CompletionItem

from haptic_accel.cli.commands import write_examples
from haptic_accel.cli.output import StoppedError, check_writable
from haptic_accel.core.parameters import Checked, read_decimal, schema, suggestion
from haptic_accel.graph.domain import NEEDS_ROS, ROS_PACKAGES
from haptic_accel.setup.words import described, group, parse_assignments

F = TypeVar("F", bound=Callable[..., Any])
Describe: TypeAlias = Callable[[], Sequence[tuple[str, str, str]]]


class Words(click.Argument):
    """The ``key:=value`` arguments of a command.

    Parameters
    ----------
    kinds : tuple of type
        Dataclasses that declare the keys.
    describe : callable, optional
        Returns name, default and description of every key; default: from `kinds`.
    """

    def __init__(
        self,
        declarations: Sequence[str],
        kinds: Sequence[type[Checked]],
        describe: Describe | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(declarations, nargs=-1, **settings)
        self.kinds = kinds
        self.describe = describe or (lambda: [line for kind in kinds for line in described(kind)])

    def write(self, formatter: click.HelpFormatter, also: Iterable[str] = ()) -> None:
        """Write the meaning of every key by group, and the keys that are also options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, default, text in self.describe():
            kind = next(kind for kind in self.kinds if name in schema(kind))
            lines = groups.setdefault(group(kind, name), [])
            lines.append((name, f"{text} (default: {default or 'empty'})"))
        keys = ", ".join(name for name in also if any(name in schema(kind) for kind in self.kinds))
        with formatter.section("Arguments, each as key:=value"):
            if keys:
                formatter.write_text(f"Also as --key VALUE: {keys}.")
            for heading, lines in groups.items():
                with formatter.section(heading) if len(groups) > 1 else nullcontext():
                    formatter.write_dl(lines)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete keys, values of keys with choices, and file names for other values."""
        key, separator, _ = incomplete.partition(":=")
        if not separator:
            keys = [f"{name}:=" for name, _, _ in self.describe()]
            found = [CompletionItem(key) for key in keys if key.startswith(incomplete)]
            return found or [CompletionItem(incomplete, type="file")]
        known = [schema(kind)[key][1] for kind in self.kinds if key in schema(kind)]
        pairs = [f"{key}:={choice}" for each in known for choice in each.choices]
        return [CompletionItem(pair) for pair in pairs if pair.startswith(incomplete)]


class AssignmentOption(click.Option):
    """Option that is equivalent to ``name:=VALUE``, and hidden in the help."""


class GroupedOption(click.Option):
    """Option under a separate heading in the help, after options without a heading.

    Parameters
    ----------
    heading : str
    """

    def __init__(self, *declarations: Any, heading: str, **settings: Any) -> None:
        super().__init__(*declarations, **settings)
        self.heading = heading


class Verb(click.Command):
    """Command whose help lists its arguments with defaults and units, and examples.

    Parameters
    ----------
    examples : sequence of str
        Command lines.
    """

    def __init__(self, *declared: Any, examples: Sequence[str] = (), **settings: Any) -> None:
        super().__init__(*declared, **settings)
        self.examples = examples

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command, with options converted to their equivalent arguments.

        A parameter named ``arguments`` receives the dataclass that declares the arguments. A file
        for results that cannot be written or updated is refused before the run; a file in a folder
        that the command will make counts as writable. A command that needs ROS 2 is refused in one
        line if ROS 2 is missing.
        """
        file, folder = ctx.params.get("json_file"), ctx.params.get("out")
        if file and folder not in file.parents:
            check_writable(file)
        if update := ctx.params.get("update"):
            from haptic_accel.setup.files import check_updatable  # slow import

            check_writable(update, "update")
            check_updatable(update)
        options = [each.name for each in self.params if isinstance(each, AssignmentOption)]
        values = {name: ctx.params.pop(name) for name in options}
        more = [f"{name}:={value}" for name, value in values.items() if value is not None]
        for each in self.params:
            if isinstance(each, Words):
                texts = [*ctx.params[each.name], *more]
                parsed = each.name == "arguments"
                ctx.params[each.name] = parse_assignments(texts, *each.kinds) if parsed else texts
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in ROS_PACKAGES:
                raise
            path = ctx.command_path.partition(" ")[2] or ctx.command_path
            raise StoppedError(f"{path} {NEEDS_ROS}") from None

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options; those with a heading come last."""
        sections: dict[str, list[tuple[str, str]]] = {"Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record and isinstance(parameter, click.Option):
                sections.setdefault(getattr(parameter, "heading", "Options"), []).append(record)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the arguments and the examples."""
        also = [str(each.name) for each in self.params if isinstance(each, AssignmentOption)]
        for parameter in self.params:
            if isinstance(parameter, Words):
                parameter.write(formatter, also)
        write_examples(formatter, self.examples)


def verb(*examples: str, name: str | None = None) -> Callable[[Callable[..., Any]], Verb]:
    """Declare a command, with examples for its help and, optionally, a name."""
    return click.command(name, cls=Verb, examples=examples)


def listed_words(text: str) -> list[str]:
    """Parse words separated by commas."""
    return text.split(",") if text else []


def one_of(known: Iterable[str]) -> Callable[[str], str]:
    """Return a parser for one of the known words; its error names the nearest one."""
    choices = list(known)

    def read(text: str) -> str:
        if text not in choices:
            near = suggestion(text, choices)
            raise click.BadParameter(f"{text!r}: must be one of {', '.join(choices)}{near}")
        return text

    return read


def some_of(known: Iterable[str]) -> Callable[[str], list[str]]:
    """Return a parser for known words separated by commas; its error names the nearest one."""
    read = one_of(known)
    return lambda text: [read(word) for word in listed_words(text)]


def listed_numbers(text: str) -> list[float]:
    """Parse numbers separated by commas."""
    try:
        return [read_decimal(word) for word in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"{text!r}: must be numbers separated by commas") from None


FILE = click.Path(path_type=Path)
"""Type of a path that need not exist."""


def update_option(content: str) -> Callable[[F], F]:
    """Add the option for a parameter file, which must exist: a typo would create a new file."""
    return click.option(
        "--update",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        metavar="FILE",
        help=f"Existing parameter file, such as that of the rig, to write {content} into; the rest"
        " of it remains.",
    )


json_option = click.option(
    "--json", "json_file", type=FILE, metavar="FILE", help="Write the results as JSON."
)
out_option = click.option(
    "--out",
    type=FILE,
    metavar="FOLDER",
    help="New folder for the results (default: results/<date and time>).",
)
lockstep_option = click.option(
    "--lockstep",
    is_flag=True,
    help="Run without ROS, on the virtual rig: faster than real time, and repeatable.",
)


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # on macOS and Windows


def workers_options(command: F) -> F:
    """Add the options for the processes that run conditions in parallel."""

    @wraps(command)
    def with_workers(*args: Any, jobs: int, executor: str, **settings: Any) -> Any:
        # Imported here, as its libraries are slow to load and only commands with conditions need
        # them.
        from haptic_accel.cli.workers import Workers

        return command(*args, workers=Workers(jobs, executor), **settings)

    option = partial(click.option, cls=GroupedOption, heading="Trials in parallel")
    jobs = option(
        "--jobs",
        type=click.IntRange(1, 1024),
        default=available_cores(),
        show_default="number of cores",
        help="Number of parallel trials, without ROS; results do not depend on it.",
    )
    executor = option(
        "--executor",
        default="",
        show_default=False,
        metavar="ADDRESS",
        help="Scheduler of dask.distributed, tcp://HOST:PORT, whose workers run the trials in"
        " place of processes of this machine (extra cluster).",
    )
    return cast("F", jobs(executor(with_workers)))


def controllers_option(known: Iterable[str], default: Iterable[str] = ()) -> Callable[[F], F]:
    """Add the option for several controllers."""
    names = list(known)
    return click.option(
        "--controllers",
        type=some_of(names),
        default=",".join(default),
        show_default=bool(default),
        metavar="NAME,NAME,...",
        help=f"Controllers to compare, among {', '.join(names)}.",
    )


def words(
    *kinds: type[Checked], describe: Describe | None = None, metavar: str = "[key:=value ...]"
) -> Callable[[F], F]:
    """Add ``key:=value`` arguments, in any order among the options."""
    return click.argument("words", cls=Words, kinds=kinds, describe=describe, metavar=metavar)


def arguments(kind: type[Checked]) -> Callable[[F], F]:
    """Add ``key:=value`` arguments, which the command receives as a dataclass."""
    return click.argument("arguments", cls=Words, kinds=[kind], metavar="[key:=value ...]")


def word_options(names: Iterable[str]) -> Callable[[F], F]:
    """Add options that are equivalent to some of the arguments."""

    def declare(command: F) -> F:
        for name in reversed([*names]):
            option = f"--{name.replace('_', '-')}"
            text = f"The same as {name}:=VALUE."
            command = click.option(option, cls=AssignmentOption, hidden=True, help=text)(command)
        return command

    return declare
