# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files in the Penn Haptic Texture Toolkit's format, with invented textures."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def hatt_file(
    orders: tuple[int, int] = (14, 12), nodes: int = 25, rate: float = 1000.0, seed: int = 0
) -> str:
    """Return a file with `nodes` on the plane, a few without variance at its edges.

    Parameters
    ----------
    orders : tuple of int
        Orders of the recursive part and of the moving average; 0 omits the latter.
    """
    random = np.random.default_rng(seed)
    inner = nodes - 10
    speeds = [*random.uniform(5, 280, inner), 0, 0, 0, 0, 100, 200, 300, 300, 150, 300]
    forces = [*random.uniform(0.2, 3.8, inner), 0, 1.3, 2.6, 4, 0, 0, 0, 4, 4, 2]
    models = []
    for number, (speed, force) in enumerate(zip(speeds, forces, strict=True)):
        variance = random.uniform(0.01, 25.0) * (speed > 0) * (force > 0)
        models.append(
            f"<model><modNum>{number + 1}</modNum>"
            + _array("ARlsf", _frequencies(random, orders[0]))
            + (_array("MAlsf", _frequencies(random, orders[1])) if orders[1] else "")
            + f"<var>{variance:f}</var>"
            + (f"<gain>{random.uniform(0.1, 2):f}</gain>" if orders[1] else "")
            + f"<speedMod>{speed:f}</speedMod><forceMod>{force:f}</forceMod></model>"
        )
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<modelSet texture="0"><material>Slate</material>'
        "<AccelUnits>m/s^2</AccelUnits><SpeedUnits>mm/s</SpeedUnits><ForceUnits>N</ForceUnits>"
        f"<SampleRate>{rate:.0f}</SampleRate><mu>0.250000</mu><numMod>{nodes}</numMod>"
        f"<maxSpeed>300</maxSpeed><maxForce>4</maxForce>{_array('speedList', speeds)}"
        f"{_array('forceList', forces)}{_array('tri', (1, 2, 3))}"
        f"<numARCoeff>{orders[0]}</numARCoeff><numMACoeff>{orders[1]}</numMACoeff>"
        f"{''.join(models)}</modelSet>\n"
    )


def _frequencies(random: np.random.Generator, order: int) -> np.ndarray:
    """Return rising frequencies, some five times as far apart as others."""
    steps = np.cumsum(random.uniform(0.2, 1.0, order + 1))
    return steps[:-1] * np.pi / steps[-1]


def _array(tag: str, values: Iterable[float]) -> str:
    return f'<{tag} type="array">{"".join(f"<value>{v:f}</value>" for v in values)}</{tag}>'
