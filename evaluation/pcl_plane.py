# SPDX-License-Identifier: BSD-3-Clause
"""PCL's fit of a plane, which the package's own is compared with (codecs/perception/ground.py says why it has one)."""
from typing import Optional, Tuple

import numpy as np

from smokebot_udp import optional
from smokebot_udp.arrays import Float32Array, FloatArray
from smokebot_udp.codecs.perception.ground import HYPOTHESES

pcl = optional.attempt('pcl').module


def fit_by_pcl(points: Float32Array, threshold: float,
               random: np.random.RandomState) -> Optional[Tuple[FloatArray, float]]:
    """As ground.fit_by_numpy, by PCL's RANSAC. It has random numbers of its own."""
    segmenter = pcl.PointCloud(points).make_segmenter()
    segmenter.set_model_type(pcl.SACMODEL_PLANE)
    segmenter.set_method_type(pcl.SAC_RANSAC)
    segmenter.set_distance_threshold(threshold)
    segmenter.set_MaxIterations(HYPOTHESES)
    segmenter.set_optimize_coefficients(True)
    inliers, coefficients = segmenter.segment()
    if not inliers:
        return None
    normal = np.array(coefficients[:3])
    scale = np.copysign(1 / np.linalg.norm(normal), normal[2])
    return normal * scale, float(coefficients[3] * scale)
