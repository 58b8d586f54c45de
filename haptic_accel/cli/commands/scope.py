"""The arguments of ``haptic-accel scope``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import scope, teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "scope",
        help=summary,
        description="Serve a page with the signals, spectra, errors and states of a graph that"
        " runs, and with controls where control:=true, until Ctrl-C. An address other than this"
        " machine's own needs a token, which is printed with the address; that of the"
        f" environment variable {scope.TOKEN_VARIABLE} is taken where it is set.",
        epilog=teleop.help_text(scope.ScopeArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.set_defaults(run=lambda arguments: scope.scope(arguments.words))
