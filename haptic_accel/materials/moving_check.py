# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compilation of an MJCF file in a separate process, with limits of time and memory.

An MJCF file can state arbitrary numbers of copies, sizes of meshes and tables, and included files.
In some cases MuJoCo's compiler does not return.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from haptic_accel.core.bounded_work import OutOfBoundsError, bounded, run_bounded
from haptic_accel.core.files import located, opened
from haptic_accel.core.parameters import ParameterError, one_line, shown

SECONDS = 2.0
"""Maximum processor time for compiling a scene and two steps, s."""

MEGABYTES = 400
"""Maximum memory, MB."""

LARGEST_FILE = 1 << 24
"""Maximum size of a file, bytes."""

MOST_GEOMS = 1000
"""Maximum number of geoms in a scene."""

SHORTEST_STEP = 2e-5
"""Minimum time step, s: fifty in a sample at 1 kHz. MuJoCo's default is 2 ms."""

MOST_ITERATIONS = 1000
"""Maximum number of solver iterations: ten times MuJoCo's default."""


def check_mjcf(path: Path) -> None:
    """Reject an MJCF file that MuJoCo cannot compile and step within limits.

    Raises
    ------
    ParameterError
        The message is one line with the file and its error.
    """
    with located(path, unreadable="must be MJCF that MuJoCo reads: "), opened(path, LARGEST_FILE):
        pass  # do not wait for a pipe
    try:
        run_bounded(__name__, [str(path.absolute())], SECONDS)
    except OutOfBoundsError as error:
        raise ParameterError(
            f"{path}: {error}: must be compiled within {SECONDS:g} s and {MEGABYTES} MB"
        ) from None


def specification(path: Path) -> Any:
    """Return the specification in an MJCF file.

    Raises
    ------
    ParameterError
        MuJoCo cannot read the file.
    """
    import mujoco

    with _read_by_mujoco(path):
        return mujoco.MjSpec.from_file(str(path))


def compiled(path: Path, stated: Any) -> Any:
    """Return the model of an MJCF file's specification.

    Raises
    ------
    ParameterError
        MuJoCo cannot compile the file, or a value is not allowed here.
    """
    with _read_by_mujoco(path):
        model = stated.compile()
    if model.ngeom > MOST_GEOMS:
        raise ParameterError(f"{path}: {model.ngeom} geoms: must be at most {MOST_GEOMS}")
    step = model.opt.timestep
    if not SHORTEST_STEP <= step < 1.0:
        raise ParameterError(f"{path}: timestep = {step:g}: must be from {SHORTEST_STEP:g} to 1 s")
    for name in (each for each in dir(model.opt) if re.search("iterations|initpoints", each)):
        if (count := getattr(model.opt, name)) > MOST_ITERATIONS:
            raise ParameterError(f"{path}: {name} = {count}: must be at most {MOST_ITERATIONS}")
    return model


def compile_and_step(path: Path) -> None:
    """Compile a file and take two steps, without limits.

    Raises
    ------
    ParameterError
        See `specification` and `compiled` for the conditions.
    """
    import mujoco

    model = compiled(path, specification(path))
    with _read_by_mujoco(path):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 2)


@contextmanager
def _read_by_mujoco(path: Path) -> Iterator[None]:
    import mujoco

    try:
        yield
    except (ValueError, mujoco.FatalError) as error:
        reason = shown(one_line(error))
        raise ParameterError(f"{path}: must be MJCF that MuJoCo reads: {reason}") from None


def main() -> None:
    """Check the file in the arguments."""
    import mujoco  # noqa: F401 - what it takes is not the file's

    bounded(lambda: compile_and_step(Path(sys.argv[1])), SECONDS, MEGABYTES)


if __name__ == "__main__":
    main()
