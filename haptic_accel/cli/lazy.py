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

"""Groups of verbs, whose code is imported on demand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import click

from haptic_accel.core.parameters import suggestion


class LazyGroup(click.Group):
    """Verbs under headings, imported one by one.

    An emergency stop must not wait for the import of plotting libraries. A verb is in its group's
    module or, if that has none of this name, in the module of its own name.

    Parameters
    ----------
    name : str
    sections : mapping
        Summaries of the verbs, by heading and name.
    groups : sequence of click.Group
        Verbs that are groups of further verbs.
    examples : sequence of str
        Command lines for the help text.
    """

    def __init__(
        self,
        name: str,
        sections: Mapping[str, Mapping[str, str]],
        *,
        groups: Sequence[click.Group] = (),
        examples: Sequence[str] = (),
        **settings: Any,
    ) -> None:
        super().__init__(name, no_args_is_help=False, subcommand_metavar="VERB ...", **settings)
        self.sections = sections
        self.verbs = [verb for verbs in sections.values() for verb in verbs]
        self.groups = {group.name: group for group in groups}
        self.examples = examples

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Require a verb."""
        if not args and not ctx.resilient_parsing:
            ctx.fail(f"a verb is missing; there are {', '.join(self.verbs)}")
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs in the order of their headings."""
        return self.verbs

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a verb."""
        if cmd_name not in self.verbs:
            return None
        if cmd_name in self.groups:
            return self.groups[cmd_name]
        names = self.name, cmd_name
        places = [f"haptic_accel.cli.{name}" for name in names]
        kits = {"emulate": "emulators", "texture": "textures"}
        for name in names:
            kit = f"haptic_accel.kits.{kits.get(name or '', name)}"
            places += [f"{kit}.command_line"] if find_spec(kit) else []
        modules = (import_module(place) for place in places if find_spec(place))
        found = (each for module in modules for each in vars(module).values())
        return next(
            each for each in found if isinstance(each, click.Command) and each.name == cmd_name
        )

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
                formatter.write_dl(list(verbs.items()))

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        write_examples(formatter, self.examples)


def write_examples(formatter: click.HelpFormatter, examples: Sequence[str]) -> None:
    """Write command lines as they are typed, one per line."""
    if examples:
        with formatter.section("Examples"):
            for example in examples:
                formatter.write(f"{'':{formatter.current_indent}}{example}\n")
