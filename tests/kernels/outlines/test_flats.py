"""Images of what is flat: areas of polygons in it, which change their signs where it is seen edge-on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.kernels.outlines.scenes import FOCAL, SIZE, compiled

TILTS = (0.4, 1.56, 1.58, 2.0)
POLYGON = 16 * SIZE**2 * np.sin(2 * np.pi / 32)
"""The area of the regular polygon of 32 corners in a circle."""


@pytest.mark.parametrize(
    ("shape", "axes", "areas"),
    [
        ("box", np.eye(3).repeat(2, axis=0), (0.06, 0.06, 0.04, 0.04, 0.06, 0.06)),
        ("bar", np.eye(3)[[2, 2, 2, 2]], (2 * SIZE**2, 2 * SIZE**2, POLYGON, POLYGON)),
    ],
)
def test_areas_of_faces_and_their_signs(shape, axes, areas):
    """A parallel projection shows a face as large as the cosine of its normal with the line of sight makes it.

    A bar has its two round faces by their four corners, and by the sides of its mantle.
    """
    shares = []
    for tilt in TILTS:
        equations, start = compiled(shape, "orthographic", angles=(0.5, tilt, 0.2))._assembled()
        (group,) = (each for each in equations.groups if each.kernel.calls[0].external.function == "area")
        stream = group.cache.stream(group.number, group.kernel)
        call = stream.calls[0][0].external
        numbers = stream.arguments(0, group.inputs_at(start[None], slice(0, 1)))
        (found,) = stream.functions.areas_of_flats(call, numbers[:, : call.figure.size])
        assert len(found) == len(areas)
        turned = Rotation.from_quat(np.roll(start[:4], -1)).as_matrix()
        # each with the axis that it is across: in the order of their sizes relative to what that shows
        cosines = axes @ turned[2] * np.array(areas) * 2 * (FOCAL / 2) ** 2
        order = [np.argsort(np.abs(found), kind="stable"), np.argsort(np.abs(cosines), kind="stable")]
        np.testing.assert_allclose(np.abs(found)[order[0]], np.abs(cosines)[order[1]], rtol=1e-9)
        shares.append(found / (turned[2] @ axes[-1]))
    if shape == "bar":
        np.testing.assert_allclose(shares, np.tile(shares[0], (len(TILTS), 1)), rtol=1e-6)
