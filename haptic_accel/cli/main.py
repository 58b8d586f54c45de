# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry point of ``haptic-accel``: emergency stop first, then subcommands and their errors.

The module imports almost nothing at first, so that on a busy machine a stop waits for Python only.
"""

from __future__ import annotations

import errno
import os
import sys

from haptic_accel.core import process

TYPE_CHECKING = False  # a stop needs no typing
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import NoReturn

    import click

    from haptic_accel.graph.stop_signal import Signalled


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Parameters
    ----------
    argv : sequence of str, optional
        Subcommand and its arguments; default: those of this process.
    """
    arguments = sys.argv[1:] if argv is None else list(argv)
    sys.unraisablehook = process.report_unraisable

    def act() -> int | None:
        signalled: Signalled | None = None
        if arguments[:1] == ["estop"]:
            from haptic_accel.graph.stop_signal import hurry, stop_at_once

            if argv is None:  # this process does nothing but the stop
                hurry()
            signalled = stop_at_once(arguments[1:])
        # Parallel runs take a core each. With little memory, BLAS would wait forever for threads
        # that it cannot start.
        for variable in process.BLAS_THREADS:
            os.environ.setdefault(variable, "1")
        from haptic_accel.cli.commands import command_line

        return _status(command_line, "haptic-accel", arguments, signalled)

    _exit(act, "haptic-accel")


def run(command: click.Command, name: str, argv: Sequence[str] | None = None) -> None:
    """Run a command and exit; report an error in one line.

    Parameters
    ----------
    command : Command
        Command that returns its exit status, or None for success.
    name : str
        Name of the program.
    argv : sequence of str, optional
        Command line; default: of this process.
    """
    _exit(lambda: _status(command, name, argv), name)


def _status(
    command: click.Command,
    name: str,
    argv: Sequence[str] | None,
    signalled: Signalled | None = None,
) -> int | None:
    from haptic_accel.cli.output import printable_output

    with printable_output():
        status = command.main(argv, name, standalone_mode=False, obj=signalled)
    return status if status is None else int(status)


def _exit(act: Callable[[], int | None], name: str) -> NoReturn:
    """Exit with the status of a function or, after one line, with that of its error.

    An error that neither arguments nor the machine's state have caused is a fault of this program,
    and is raised.
    """
    try:
        status = act() or process.DONE
        if sys.stdout:
            sys.stdout.flush()
    except KeyboardInterrupt:
        status = process.INTERRUPTED
    except Exception as error:
        answer = _answer(error)
        if not answer:
            raise
        line, status = answer
        if line:
            from haptic_accel.core.parameters import printable

            _print_error(printable(f"{name}: {' '.join(line.split())}"))
    _leave_output()
    sys.exit(status)


def _answer(error: Exception) -> tuple[str, int] | None:
    """Return the line and the exit status for an error; None if it is a fault of this program."""
    if short := process.shortage(error):
        return short, process.FAILED
    if isinstance(error, OSError):
        return _of_system(error), process.FAILED
    import click

    from haptic_accel.cli.output import StoppedError
    from haptic_accel.core.parameters import ParameterError

    if isinstance(error, click.Abort):
        return "", process.INTERRUPTED
    if isinstance(error, click.ClickException):
        return error.format_message(), process.WRONG_ARGUMENTS
    if isinstance(error, ParameterError):
        return str(error), process.WRONG_ARGUMENTS
    if isinstance(error, StoppedError):
        return str(error), error.status
    if isinstance(error, ModuleNotFoundError):
        module = f"{error.name}".partition(".")[0]
        return None if module == "haptic_accel" else (_missing(module), process.FAILED)
    return None


def _missing(module: str) -> str:
    """Return how to install the library of a missing module."""
    import re
    from collections import Counter
    from contextlib import suppress
    from importlib import metadata

    from haptic_accel.bags import NO_ROSBAGS, OF_ROSBAGS

    if module in OF_ROSBAGS:
        return NO_ROSBAGS
    with suppress(metadata.PackageNotFoundError):
        lines = metadata.requires("haptic_accel") or []
        found = [re.fullmatch(r"([\w.-]+).*extra == \W([\w-]+)\W.*", line) for line in lines]
        pairs = [each.groups() for each in found if each]
        sizes = Counter(extra for _, extra in pairs)
        if extras := [extra for name, extra in pairs if name == module]:
            # The smallest one is for users, not for development.
            smallest = min(extras, key=sizes.__getitem__)
            return f"needs {module}: pip install 'haptic_accel[{smallest}]'"
    return f"needs {module}, which is not installed"


def _of_system(error: OSError) -> str:
    """Return an operating system error as text; empty if the output's reader has gone."""
    reason = error.strerror or str(error)
    if error.filename is not None:
        return f"{error.filename}: {reason}"
    if error.errno == errno.EPIPE:
        return ""
    return f"output: {reason}" if error.errno in (errno.ENOSPC, errno.EDQUOT) else reason


def _print_error(line: str) -> None:
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:  # standard error is closed, too
        return


def _leave_output() -> None:
    """Drop output that the standard streams cannot write: Python would retry at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream:
                stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    main()
