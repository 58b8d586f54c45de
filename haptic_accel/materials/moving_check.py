# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compilation of an MJCF file in a separate process, with limits of time and memory.

Counts of copies, sizes of meshes and tables, and files that it includes are all within its bounds:
where one is beyond, the compiler of MuJoCo does not return.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from haptic_accel.core.bounded_files import located, opened
from haptic_accel.core.bounded_work import OutOfBoundsError, bounded, run_bounded
from haptic_accel.core.parameters import ParameterError, one_line, shown

SECONDS = 2.0
"""Time of the processor in which a scene must be compiled and take two steps, s."""

MEGABYTES = 400
"""Memory that it may take, MB."""

LARGEST = 1 << 24
"""Largest file, bytes."""

MOST_GEOMS = 1000
"""Geoms of a scene."""

SHORTEST_STEP = 2e-5
"""Shortest time step, s: fifty in a sample at 1 kHz. MuJoCo's default is 2 ms."""

MOST_ITERATIONS = 1000
"""Iterations of a solver: ten times those of MuJoCo's default."""

_ITERATIONS = (
    *("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"),
    *("sdf_iterations", "sdf_initpoints"),
)


def check_mjcf(path: Path) -> None:
    """Refuse an MJCF file that MuJoCo cannot compile and step within bounds.

    Raises
    ------
    ParameterError
        In one line: the file and what is wrong with it.
    """
    with located(path, unreadable="must be MJCF that MuJoCo reads: "), opened(path, LARGEST):
        pass  # a pipe is not waited for
    try:
        run_bounded(__name__, [str(path.absolute())], SECONDS)
    except OutOfBoundsError as error:
        raise ParameterError(
            f"{path}: {error}: must be compiled within {SECONDS:g} s and {MEGABYTES} MB"
        ) from None


def specification(path: Path) -> Any:
    """Return what an MJCF file states.

    Raises
    ------
    ParameterError
        MuJoCo cannot read it.
    """
    import mujoco

    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise _refused(path, error) from None


def compiled(path: Path, stated: Any) -> Any:
    """Return the model of what an MJCF file states.

    Raises
    ------
    ParameterError
        MuJoCo cannot compile it, or a value is not allowed here.
    """
    import mujoco

    try:
        model = stated.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise _refused(path, error) from None
    if model.ngeom > MOST_GEOMS:
        raise ParameterError(f"{path}: {model.ngeom} geoms: must be at most {MOST_GEOMS}")
    step = model.opt.timestep
    if not SHORTEST_STEP <= step < 1.0:
        raise ParameterError(f"{path}: timestep = {step:g}: must be from {SHORTEST_STEP:g} to 1 s")
    for name in _ITERATIONS:
        if (count := getattr(model.opt, name, 0)) > MOST_ITERATIONS:
            raise ParameterError(f"{path}: {name} = {count}: must be at most {MOST_ITERATIONS}")
    return model


def compile_and_step(path: Path) -> None:
    """Compile a file and take two steps, whatever they cost.

    Raises
    ------
    ParameterError
        As `specification` and `compiled`.
    """
    import mujoco

    model = compiled(path, specification(path))
    try:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 2)
    except (ValueError, mujoco.FatalError) as error:
        raise _refused(path, error) from None


def _refused(path: Path, error: Exception) -> ParameterError:
    reason = shown(one_line(error))
    return ParameterError(f"{path}: must be MJCF that MuJoCo reads: {reason}")


def main() -> None:
    """Check the file that is named."""
    import mujoco  # noqa: F401 - what it takes is not the file's

    bounded(lambda: compile_and_step(Path(sys.argv[1])), SECONDS, MEGABYTES)


if __name__ == "__main__":
    main()
