"""Groups of verbs whose code is imported when a verb is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import click

from haptic_accel.core.parameters import suggestion


class Lazy(NamedTuple):
    """A verb that is not imported yet.

    Attributes
    ----------
    summary : str
        One line for the list of verbs.
    place : str or click.Group
        ``module:name`` of the command in this package, or a group of further verbs.
    """

    summary: str
    place: str | click.Group


class LazyGroup(click.Group):
    """Verbs under headings, imported one by one.

    An emergency stop must not wait for the import of what draws plots.

    Parameters
    ----------
    name : str
    sections : mapping
        Verbs by heading and name.
    examples : sequence of str
        Command lines for the help text.
    """

    def __init__(
        self,
        name: str,
        sections: Mapping[str, Mapping[str, Lazy]],
        *,
        examples: Sequence[str] = (),
        **settings: Any,
    ) -> None:
        super().__init__(name, no_args_is_help=False, subcommand_metavar="VERB ...", **settings)
        self.sections = sections
        self.verbs = {verb: lazy for verbs in sections.values() for verb, lazy in verbs.items()}
        self.examples = examples

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Require a verb."""
        if not args and not ctx.resilient_parsing:
            ctx.fail(f"a verb is missing; there are {', '.join(self.verbs)}")
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs in the order of their headings."""
        return list(self.verbs)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a verb."""
        if cmd_name not in self.verbs:
            return None
        place = self.verbs[cmd_name].place
        if isinstance(place, click.Group):
            return place
        module, _, name = place.partition(":")
        found: click.Command = getattr(import_module(f"haptic_accel.cli.{module}"), name)
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the verb of a command line, or name the nearest one."""
        word = args[0]
        if word in self.verbs or word.startswith("-") or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        near = suggestion(word, self.verbs)
        ctx.fail(f"{word}: no such verb{near}; there are {', '.join(self.verbs)}")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs' summaries, without importing any."""
        for heading, verbs in self.sections.items():
            with formatter.section(heading):
                formatter.write_dl([(verb, lazy.summary) for verb, lazy in verbs.items()])

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        write_examples(formatter, self.examples)


def write_examples(formatter: click.HelpFormatter, examples: Sequence[str]) -> None:
    """Write command lines as they are typed, one per line."""
    if examples:
        with formatter.section("Examples"):
            for example in examples:
                formatter.write(f"{'':{formatter.current_indent}}{example}\n")
