# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from collections.abc import Callable
from typing import Any

from haptic_accel.analysis.notebook import (NotebookTrial as NotebookTrial, Rig as Rig,
    run_trial as run_trial)
from haptic_accel.bags.reading import Bag as Bag, read_bag as read_bag
from haptic_accel.core.axes import Axes as Axes
from haptic_accel.core.control.error_bound import causal_bound as causal_bound
from haptic_accel.core.control.inversion import (Goal as Goal, design_inverse as design_inverse,
    predict as predict)
from haptic_accel.core.coupling.passive import PassiveParameters as PassiveParameters
from haptic_accel.core.evaluation.metrics import (align as align,
    indistinguishable as indistinguishable, nrmse as nrmse)
from haptic_accel.core.handle.plant import IdentifiedPlant as IdentifiedPlant, Plant as Plant
from haptic_accel.core.identification.evaluation import identify_handle as identify_handle
from haptic_accel.core.identification.sweep import SweepParameters as SweepParameters
from haptic_accel.core.model import (FloatArray as FloatArray, GripParameters as GripParameters,
    HandleParameters as HandleParameters, MountParameters as MountParameters, Vector as Vector,
    held as held)
from haptic_accel.core.network import ChannelParameters as ChannelParameters
from haptic_accel.core.parameters import (Checked as Checked, ParameterError as ParameterError,
    parameter as parameter)
from haptic_accel.core.rig.master_rig import MasterRigParameters as MasterRigParameters
from haptic_accel.core.sampling import resampled as resampled
from haptic_accel.core.surfaces.texture import (Provenance as Provenance, Texture as Texture,
    TextureModel as TextureModel)
from haptic_accel.core.trial import Trial as Trial, run_identification as run_identification
from haptic_accel.materials.folders import preset_file as preset_file
from haptic_accel.materials.scenes import read_scene as read_scene
from haptic_accel.materials.texture_files import read_texture as read_texture
from haptic_accel.setup.arguments import GraphArguments as GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial as lockstep_trial
from haptic_accel.setup.setup import Setup as Setup

__version__: str
def lazy_names(root: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]: ...
