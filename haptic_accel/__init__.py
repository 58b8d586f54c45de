# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Teleoperation with high-frequency acceleration feedback.

The public interface has five roots: `haptic_accel` for notebooks, scripts and parameters;
`haptic_accel.controllers` and `haptic_accel.devices` for controllers and devices of other
packages; `haptic_accel.analysis` for bags as data frames; `haptic_accel.commands` for additional
commands.

Examples
--------
>>> from haptic_accel import run_trial
>>> trial = run_trial("dynamic", rig="ideal", surface="text", duration=2.0)
>>> 0.0 < trial.nrmse() < 50.0
True
"""

from __future__ import annotations

from os.path import dirname, exists, join

TYPE_CHECKING = False  # an emergency stop must not wait for typing
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

__version__ = "0.3.0"


def lazy_names(root: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a root that loads its names at their first use.

    Parameters
    ----------
    root, file : str
        Name and file of the root. For type checkers, a stub in the same folder imports the names.
    """
    known: dict[str, str] = {}

    def modules() -> dict[str, str]:
        if not known:
            from ast import ImportFrom, parse

            with open(f"{file}i", encoding="utf-8") as stub:
                imports = [
                    each for each in parse(stub.read()).body if isinstance(each, ImportFrom)
                ]
            for each in imports:
                # "X as X" is the form of a name to export.
                known.update((name.name, each.module or "") for name in each.names if name.asname)
        return known

    def load(name: str) -> Any:
        if name == "__all__":
            return sorted(modules())
        # Modules of the package itself import its modules, without a look into the stub.
        is_module = exists(join(dirname(file), name)) or exists(join(dirname(file), f"{name}.py"))
        if name.startswith("__") or is_module or name not in modules():
            raise AttributeError(f"module {root!r} has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(modules()[name]), name)

    return load, lambda: sorted(modules())


__getattr__, __dir__ = lazy_names(__name__, __file__)
