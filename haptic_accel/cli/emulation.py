"""What the emulators have in common: their folder, their rig, and how long they go on."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import yaml

from haptic_accel.cli.running import StopOnSignal
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import RigParameters
from haptic_accel.graph.arguments import GraphArguments
from haptic_accel.graph.processes import graph_parameters, rig_parameters


def virtual_rig(rig: str, grip: str, surface: str, seed: int) -> RigParameters:
    """Return the virtual rig behind what is emulated, by the arguments of a graph."""
    graph = GraphArguments(rig=rig, grip=grip, surface=surface, seed=seed)
    return rig_parameters(graph_parameters(graph))


def emulation_folder(given: str, kind: str) -> Path:
    """Return the folder for what is made, which may be new; a temporary one where none is given.

    Raises
    ------
    ParameterError
        It is no folder and cannot be made.
    """
    if not given:
        return Path(tempfile.mkdtemp(prefix=f"haptic-accel-{kind}-"))
    folder = Path(given).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(
            f"folder = '{given}': must be a folder or new: {error.strerror}"
        ) from None
    return folder


def write_parameters(path: Path, device: str, given: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the parameter file of a graph that uses what is emulated.

    Parameters
    ----------
    path : Path
    device : str
        Name of the devices.
    given : mapping
        Per arm its device's parameters.
    """
    content = {
        f"{arm}_device": {"ros__parameters": {device: dict(values)}}
        for arm, values in given.items()
    }
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


@contextmanager
def until_stopped(
    duration: float, begun: Callable[[], bool], line: str
) -> Iterator[Callable[[], bool]]:
    """Give what tells whether to end: a signal came, or the duration is over.

    Parameters
    ----------
    duration : float
        s; 0 for no end.
    begun : callable
        Whether what is worth telling has happened.
    line : str
        What is printed then, once.
    """
    start, told = monotonic(), False
    with StopOnSignal() as stopped:

        def ended() -> bool:
            nonlocal told
            if begun() and not told:
                told = True
                print(line, flush=True)
            over = duration and monotonic() - start >= duration
            return bool(over) or stopped()

        yield ended
