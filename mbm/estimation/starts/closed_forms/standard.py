"""The closed forms that mbm brings, in the order in which they are tried."""

from __future__ import annotations

from mbm.estimation.starts.closed_forms.hand_eye import DATUM, HAND_EYE
from mbm.estimation.starts.closed_forms.intersection import INTERSECTION
from mbm.estimation.starts.closed_forms.linear import LINEAR, SCALED_RANGES
from mbm.estimation.starts.closed_forms.measured import MEASURED
from mbm.estimation.starts.closed_forms.multilateration import MULTILATERATION
from mbm.estimation.starts.closed_forms.planar_calibration import PLANAR_CALIBRATION
from mbm.estimation.starts.closed_forms.planes import PLANES
from mbm.estimation.starts.closed_forms.pose_and_focal_length import POSE_AND_FOCAL_LENGTH
from mbm.estimation.starts.closed_forms.pose_from_points import POSE_FROM_POINTS
from mbm.estimation.starts.closed_forms.pose_in_parallel import POSE_IN_PARALLEL
from mbm.estimation.starts.closed_forms.pose_in_product import POSE_IN_PRODUCT
from mbm.estimation.starts.closed_forms.relative_poses import RELATIVE_POSES
from mbm.estimation.starts.closed_forms.similarity import SIMILARITY
from mbm.estimation.starts.closed_forms.structure_and_camera import STRUCTURE_AND_CAMERA
from mbm.estimation.starts.closed_forms.structure_from_motion import STRUCTURE_FROM_MOTION
from mbm.estimation.starts.closed_forms.types import ClosedForm

STANDARD: tuple[ClosedForm, ...] = (
    LINEAR,
    SIMILARITY,
    MULTILATERATION,
    SCALED_RANGES,
    PLANES,
    POSE_IN_PRODUCT,
    POSE_FROM_POINTS,
    POSE_IN_PARALLEL,
    POSE_AND_FOCAL_LENGTH,
    INTERSECTION,
    STRUCTURE_FROM_MOTION,
    STRUCTURE_AND_CAMERA,
    PLANAR_CALIBRATION,
    MEASURED,
    RELATIVE_POSES,
    HAND_EYE,
    DATUM,
)
