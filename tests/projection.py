"""Slow, obviously right projection of moving scenes, in plain matrices, and its exact derivative in time.

The displacement is the exponential of a 4×4 generator; the derivative is taken by a complex step, which has no
truncation and no rounding of differences: with h = 1e-30, Im f(i h)/h is f'(0).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from sixflow.scenes import Camera, RigidMotion

_STEP = 1e-30


def generator(motion: RigidMotion) -> np.ndarray:
    """4×4 generator of the body's own motion, in homogeneous coordinates."""
    T = np.zeros((4, 4))
    T[:3, :3] = np.stack([np.cross(motion.rotation, axis) for axis in np.eye(3)], axis=1)
    T[:3, 3] = np.array(motion.translation) - np.cross(motion.rotation, motion.point)
    return T


def scene_generator(motion: RigidMotion) -> np.ndarray:
    """The same of the scene relative to the camera: a camera's pose is exp(s T), the scene goes by its inverse."""
    return generator(motion) if motion.of == "object" else -generator(motion)


def image_point(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(x, y), shape (..., 2), of scene points, real or complex."""
    return np.array(camera.centre) + camera.focal * points[..., :2] / points[..., 2:]


def displaced(camera: Camera, motion: RigidMotion, x, y, depth, s: complex = 1.0) -> np.ndarray:
    """Where image points of known depth are after the time s, shape (..., 2)."""
    ray = np.stack([(x - camera.centre[0]) / camera.focal, (y - camera.centre[1]) / camera.focal], axis=-1)
    points = np.concatenate([ray, np.ones((*ray.shape[:-1], 1))], axis=-1) * np.asarray(depth)[..., None]
    M = expm(s * scene_generator(motion))
    return image_point(camera, points @ M[:3, :3].T + M[:3, 3])


def velocity(camera: Camera, motion: RigidMotion, x, y, depth) -> np.ndarray:
    """Velocity of image points of known depth, shape (..., 2)."""
    return displaced(camera, motion, x, y, depth, 1j * _STEP).imag / _STEP


def derivatives(function, x, y, h: float = 0.25) -> np.ndarray:
    """Six numbers of a displacement or velocity (..., 2) over the image, by differences of fourth order."""

    k = np.array([0, 1, -1, 2, -2, 0, 0, 0, 0]).reshape(-1, *(1,) * np.ndim(x))
    at = function(x + h * k, y + h * np.roll(k, 4, axis=0))
    u_x, v_x = np.moveaxis(8 * (at[1] - at[2]) - (at[3] - at[4]), -1, 0) / (12 * h)
    u_y, v_y = np.moveaxis(8 * (at[5] - at[6]) - (at[7] - at[8]), -1, 0) / (12 * h)
    u, v = np.moveaxis(at[0], -1, 0)
    return np.stack([u, v, u_x + v_y, v_x - u_y, u_x - v_y, u_y + v_x], axis=-1)
