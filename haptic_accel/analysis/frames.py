"""The figures of bags as data frames, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptic_accel.analysis.comparison import Comparison, check_comparison
from haptic_accel.analysis.comparison import compare as compared
from haptic_accel.analysis.loading import Analysis, analyse
from haptic_accel.analysis.measures import PERCENT, Shift
from haptic_accel.analysis.segments import cut
from haptic_accel.analysis.tables import group_row, trial_row
from haptic_accel.analysis.tables import groups as grouped
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.evaluation.statistics import PairedDifference
from haptic_accel.core.parameters import ParameterError

if TYPE_CHECKING:
    import pandas as pd

# pandas takes half a second to import: only who wants a frame waits for it.


def load(*paths: Path | str, shift: str = "paper", perceptual: bool = True) -> Analysis:
    """Analyse bags.

    Parameters
    ----------
    *paths : Path or str
        Bags, files of bags, or folders in which to look for bags.
    shift : str
        ``paper`` for one sample, ``measured``, or milliseconds.
    perceptual : bool
        Whether to score ST-SIM and SPQI, which takes longest.

    Returns
    -------
    Analysis
        For the other functions here; `Analysis.problems` says what cannot be said.

    Raises
    ------
    ParameterError
        A place does not exist or has no bag, or the shift is none.
    """
    return analyse([Path(p) for p in paths], Shift.read(shift), perceptual=perceptual)


def trials(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each trial: condition, and all figures with their unit in the name."""
    import pandas as pd

    return pd.DataFrame([trial_row(trial) for trial in analysis.trials])


def groups(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each controller and surface, with intervals of 95 %.

    The column ``interval`` says how that of the NRMSE was found: over trials, or over pieces of
    the only one.
    """
    import pandas as pd

    return pd.DataFrame([group_row(group) for group in grouped(analysis.trials)])


def bands(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each trial and band: its NRMSE in percent."""
    import pandas as pd

    columns = ["trial", "controller", "surface", "band", "nrmse_percent"]
    return pd.DataFrame(
        [
            (trial.name, trial.controller, trial.surface, band, PERCENT * error)
            for trial in analysis.trials
            if trial.measures.fidelity
            for band, error in trial.measures.fidelity.bands.items()
        ],
        columns=columns,
    )


def spectra(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each trial and frequency in Hz: densities in m/s²/√Hz, and coherence."""
    import pandas as pd

    frames = []
    for trial in analysis.trials:
        if trial.measures.fidelity:
            found = trial.measures.fidelity.spectra
            columns = {
                "frequency_Hz": found.frequency,
                "desired": found.desired,
                "actual": found.actual,
                "coherence": found.coherence,
            }
            frames.append(pd.DataFrame({"trial": trial.name, **columns}))
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def signals(path: Path | str, number: int = 1) -> pd.DataFrame:
    """Return the samples of one trial of a bag, by time in s.

    Parameters
    ----------
    path : Path or str
        Of one bag.
    number : int
        Which of the bag's trials, from 1.

    Returns
    -------
    DataFrame
        Tool, desired and handle acceleration in m/s^2 and actuator force in N, as far as recorded,
        by the names of their topics.

    Raises
    ------
    ParameterError
        It is no bag, or has no such trial.
    """
    import pandas as pd

    stretches = cut(read_bag(Path(path))).stretches
    if not 1 <= number <= len(stretches):
        raise ParameterError(f"number = {number}: must be from 1 to {len(stretches)} in {path}")
    stretch = stretches[number - 1]
    length = max(map(len, stretch.signals.values()))
    time = pd.Index(np.arange(length) / stretch.rate, name="time_s")
    return pd.DataFrame(dict(stretch.signals), index=time)


def compare(analysis: Analysis, wanted: str, places: Sequence[Path] = ()) -> pd.DataFrame:
    """Return whether two controllers differ: a row for all surfaces, and one for each.

    Parameters
    ----------
    analysis : Analysis
    wanted : str
        ``controller:A,B``, or ``runs``.
    places : sequence of Path
        With ``runs``, the two places that were loaded.

    Raises
    ------
    ParameterError
        There is no such comparison.
    """
    import pandas as pd

    check_comparison(wanted, places)
    return pd.DataFrame(comparison_rows(compared(analysis.trials, wanted, places)))


def comparison_rows(comparison: Comparison) -> list[dict[str, float | str]]:
    """Return a comparison as rows for tables and files."""

    def row(surface: str, found: PairedDifference) -> dict[str, float | str]:
        return {
            "first": comparison.first,
            "second": comparison.second,
            "surface": surface,
            "pairs": found.n,
            "difference_percent": found.mean.value,
            "low_percent": found.mean.low,
            "high_percent": found.mean.high,
            "effect": found.effect,
            "t": found.t,
            "p_t": found.p_t,
            "p_wilcoxon": found.p_wilcoxon,
            "verdict": found.verdict,
        }

    return [
        row("all", comparison.overall),
        *(row(surface, found) for surface, found in comparison.by_surface.items()),
    ]
