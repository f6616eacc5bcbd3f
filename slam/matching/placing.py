"""Putting a cloud where it was seen from."""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.matching.kernels import pair_covariance


@njit(cache=True)
def place(cloud, T_map_cloud, room, first):
    """Write a cloud, moved by ``T_map_cloud (3,)``, into the rows of ``room`` from ``first`` on."""
    points, normals, covariance, tangent_sigma = cloud
    room_points, room_normals, room_covariance, room_sigma = room
    c, s = np.cos(T_map_cloud[2]), np.sin(T_map_cloud[2])
    nothing = np.zeros((2, 2))
    for i in range(len(points)):
        k = first + i
        room_points[k, 0] = c * points[i, 0] - s * points[i, 1] + T_map_cloud[0]
        room_points[k, 1] = s * points[i, 0] + c * points[i, 1] + T_map_cloud[1]
        room_normals[k, 0] = c * normals[i, 0] - s * normals[i, 1]
        room_normals[k, 1] = s * normals[i, 0] + c * normals[i, 1]
        xx, xy, yy = pair_covariance(nothing, covariance[i], c, s)
        room_covariance[k, 0, 0], room_covariance[k, 1, 1] = xx, yy
        room_covariance[k, 0, 1] = room_covariance[k, 1, 0] = xy
        room_sigma[k] = tangent_sigma[i]
