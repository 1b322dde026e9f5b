"""Patches: operators on neighbourhoods that are cut out are those at points of a frame."""

from __future__ import annotations

import numpy as np
import pytest

from sixflow import synth
from sixflow.convention import six_from_coefficients
from sixflow.eigenfilters import JointOperator, PooledOperator, default_bank
from sixflow.eigenfilters.patches import patch_blocks
from sixflow.errors import InputError

RADIUS, WINDOW = 64, 31
ALL = np.array([-7.0, 5.0, 0.15, -0.4, 0.07, 0.08])  # τ


def frames(pattern, six, noise=0.0, seed=0, radius=RADIUS):
    motion = synth.Affine.from_six(tuple(six), centre=(radius, radius))
    made = synth.pair(pattern, motion, (2 * radius + 1,) * 2, sensor=synth.Sensor(noise=noise, seed=seed))
    return made.frame0, made.frame1


class TestPatches:
    def test_noise_does_not_shrink_the_motion(self):
        """As much noise as signal in the gradients: Γ of `pooled` is half of the normal matrix."""
        motion = synth.Affine.translation(0.3, -0.2)
        made = synth.pair(synth.Speckle(seed=3), motion, (257, 257), sensor=synth.Sensor(noise=35 / 2))
        x, y = (c.ravel() for c in np.meshgrid(np.arange(48, 220, 40), np.arange(48, 220, 40)))
        found = PooledOperator(WINDOW).estimate(made.frame0, made.frame1, x, y)
        error = found.six[:, :2] - [0.3, -0.2]
        spread = np.sqrt(np.mean(np.diagonal(found.covariance, axis1=1, axis2=2)[:, :2], axis=0) / len(x))
        assert (np.abs(error.mean(axis=0)) < 4 * spread).all()
        assert (4 * spread < 0.12).all()  # without Γ u is 0.15

    def test_the_same_as_points_of_a_frame(self):
        frame0, frame1 = frames(synth.Speckle(), six_from_coefficients(ALL / 100), noise=1)
        x, y = np.array([60, 64]), np.array([64, 58])
        joint = JointOperator(default_bank(21))
        [(_, stacks)] = patch_blocks((frame0, frame1), x, y, joint.bank.radius)
        direct, by_patch = joint.estimate(frame0, frame1, x, y), joint.estimate_patches(*stacks)
        np.testing.assert_allclose(by_patch.six, direct.six, atol=1e-5)
        array = PooledOperator(21)
        [(_, stacks)] = patch_blocks((frame0, frame1), x, y, array.reach)
        direct = array.estimate(frame0, frame1, x, y)
        by_patch = array.estimate_patches(*stacks, np.ones(stacks[0].shape, dtype=bool))
        np.testing.assert_allclose(by_patch.six, direct.six, atol=1e-9)
        np.testing.assert_allclose(by_patch.covariance, direct.covariance, rtol=1e-6)

    def test_pixels_that_are_not_counted(self):
        array = PooledOperator(21)
        side = 2 * array.reach + 1
        frame0, frame1 = (f.reshape(1, -1) for f in frames(synth.Speckle(), ALL / 1000, radius=array.reach))
        counted = np.ones((side, side), dtype=bool)
        counted[:, -8:] = False
        spoilt = np.where(counted.ravel(), frame1, 0.0)
        found = array.estimate_patches(frame0, spoilt, counted.reshape(1, -1))
        np.testing.assert_allclose(
            found.six, array.estimate_patches(frame0, frame1, counted.reshape(1, -1)).six
        )
        assert np.isnan(array.estimate_patches(frame0, frame1, np.zeros_like(frame0, dtype=bool)).six).all()

    def test_wrong_shapes(self):
        joint, array = JointOperator(default_bank(21)), PooledOperator(21)
        with pytest.raises(InputError, match="patches of"):
            joint.estimate_patches(np.zeros((2, 9)), np.zeros((2, 9)))
        with pytest.raises(InputError, match="patches of"):
            array.estimate_patches(np.zeros((2, 9)), np.zeros((2, 9)), np.ones((2, 9), dtype=bool))
