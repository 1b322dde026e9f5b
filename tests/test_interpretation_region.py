"""Least squares over a region: correlation of points, the model of a plane under windows, standard errors."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import sixflow
from interpreted import (
    CAMERA,
    ERROR,
    SHAPE,
    SIGMA,
    covariance_of_point,
    make_field,
    plane_in_view,
    smooth_noise,
)
from sixflow import synth
from sixflow.convention import SIX_FROM_GRADIENT, numerical_jacobian
from sixflow.convention.flags import FLAGS
from sixflow.engine.response import response as response_of
from sixflow.engine.window import sharpening_noise
from sixflow.errors import InputError, MeasurementError
from sixflow.interpretation import fit_region
from sixflow.interpretation.correlation import Correlation, unknowns_from_six
from sixflow.interpretation.model import plane_in_window
from sixflow.scenes import Plane, RigidMotion, homography_flow, plane_homography

PLANE = Plane.from_slant(2.0, 0.7, 0.5)
MOTION = RigidMotion((0.03, 0.02, 0.045), (0.004, -0.006, 0.01))


def still(x, y):
    return np.zeros((*x.shape, 6))


# Correlation


def spectrum_of(sharpen, size=256, share=0.0):
    """Power of the errors of (u, σu_x, σu_y), from the response of the passes: naive, on a periodic lattice."""
    k = 2 * np.pi * np.fft.fftfreq(size)
    ky, kx = np.meshgrid(k, k, indexing="ij")
    M = np.exp(-(kx**2 + ky**2) * SIGMA**2 / 2)
    response = response_of(M, sharpen)
    response = response / (1 + share * (1 - response))
    return np.stack([response, 1j * kx * SIGMA * response, 1j * ky * SIGMA * response])


@pytest.mark.parametrize(("sharpen", "share"), [(0, 0), (1, 0), (4, 0), (0, 0.02), (0, 0.6), (0, 4)])
def test_correlation_against_the_spectrum_of_the_response(sharpen, share):
    parts = spectrum_of(sharpen, 512, share)
    covariance = np.fft.ifft2(np.conj(parts)[:, None] * parts[None]).real  # [i, j, dy, dx], d = q − p
    size = np.sqrt(np.diagonal(covariance[..., 0, 0]))
    expected = covariance / (size[:, None] * size[None])[..., None, None]
    x, y = np.array([0.0, 5.0, 12.0, 40.0]), np.array([0.0, 9.0, 16.0])
    one = np.zeros((3, 4, 6, 6))
    one[0, 0] = np.eye(6)
    seen = Correlation(x, y, SIGMA, sharpen, share).apply(one)  # R[q, (0, 0)] = R[(0, 0), q] transposed
    for row, dy in enumerate(y.astype(int)):
        for column, dx in enumerate(x.astype(int)):
            block = np.kron(np.eye(2), expected[:, :, dy, dx])
            np.testing.assert_allclose(seen[row, column].T, block, atol=1e-6 if share == 0 else 1e-3)


@pytest.mark.parametrize("sharpen", [1, 2, 8])
def test_correlation_has_the_noise_of_sharpening(sharpen):
    parts, whole = spectrum_of(sharpen), spectrum_of(0)
    factor = [np.sqrt((np.abs(parts[k]) ** 2).sum() / (np.abs(whole[k]) ** 2).sum()) for k in (0, 1)]
    assert factor == pytest.approx(list(sharpening_noise(sharpen)), rel=1e-3)


@pytest.mark.parametrize("sharpen", [0, 3])
def test_correlation_is_symmetric_and_positive(sharpen):
    x, y = np.array([0.0, 8.0, 16.0, 40.0]), np.array([3.0, 19.0])
    R = Correlation(x, y, SIGMA, sharpen).apply(np.eye(48).reshape(2, 4, 6, 48)).reshape(48, 48)
    np.testing.assert_allclose(R, R.T, atol=1e-9)
    np.testing.assert_allclose(np.diag(R), 1, atol=1e-7)
    assert np.linalg.eigvalsh(R).min() > -1e-7


def test_unknowns_of_a_uniform_texture_have_independent_errors_of_two_sizes():
    T = unknowns_from_six(SIGMA)
    spread = T @ covariance_of_point() @ T.T
    np.testing.assert_allclose(spread, ERROR**2 * np.diag([1, 0.5, 0.5] * 2), atol=1e-20)


# Model


@pytest.mark.parametrize("motion", [MOTION, RigidMotion((0.2, 0.1, 0.3), (0.05, -0.1, 0.2))])
def test_model_is_the_displacement_of_a_plane_seen_through_windows(motion):
    flow = homography_flow(plane_homography(CAMERA, PLANE, motion)).coefficients
    x, y = np.array([10.0, 60.0, 150.0]), np.array([20.0, 130.0, 60.0])
    for blur in (0.0, SIGMA**2):
        six, _ = plane_in_window(flow, x, y, blur)
        np.testing.assert_allclose(
            six, plane_in_view(CAMERA, PLANE, motion, blur)(x, y), rtol=1e-7, atol=1e-7
        )


def test_derivative_of_the_model():
    scale = np.array([1, 1, *[1e-2] * 4, 1e-4, 1e-4])
    theta = homography_flow(plane_homography(CAMERA, PLANE, MOTION)).coefficients
    x, y = np.array([10.0, 60.0]), np.array([-20.0, 30.0])

    def six(units):
        return np.stack([plane_in_window(t, x, y, 0.0)[0] for t in units.reshape(-1, 8) * scale]).reshape(
            *units.shape[:-1], 2, 6
        )

    expected = numerical_jacobian(six, theta / scale) / scale
    _, found = plane_in_window(theta, x, y, 0.0)
    np.testing.assert_allclose(found * scale, expected * scale, rtol=1e-6, atol=1e-8)


def test_rendered_plane_is_seen_as_the_model_says():
    """What a window adds to the displacement of a slanted plane, on a texture, without noise."""
    view = synth.PlaneInView(CAMERA, PLANE, MOTION)
    made = synth.pair(synth.Speckle(seed=4), view, SHAPE)
    field = sixflow.measure(made.frame0, made.frame1, window=31)
    x, y = np.meshgrid(field.x, field.y)
    whole = (
        field.flag.values[0] & ~np.uint16(FLAGS["unresolved"])
    ) == 0  # without noise, all that is left is bias
    seen = np.stack([field.u.values[0], field.v.values[0]], axis=-1) - made.truth(x, y)[..., :2]
    expected = (plane_in_view(CAMERA, PLANE, MOTION)(x.astype(float), y.astype(float)) - made.truth(x, y))[
        ..., :2
    ]
    # the texture weighs windows unevenly, and what the blend misses is seen to second order
    np.testing.assert_allclose(seen[whole].mean(axis=0), expected[whole].mean(axis=0), rtol=0.1, atol=1e-4)


# The fit


@pytest.mark.parametrize("sharpen", [0, 2])
@pytest.mark.parametrize("motion", [MOTION, RigidMotion((0.2, 0.1, 0.3), (0.05, -0.1, 0.2))])
def test_exact_field_gives_the_exact_flow(motion, sharpen):
    six_at = plane_in_view(CAMERA, PLANE, motion, blur=0.0 if sharpen else SIGMA**2)
    fit = fit_region(make_field(six_at, sharpen=sharpen), (20, 30, 140, 120))
    truth = homography_flow(plane_homography(CAMERA, PLANE, motion), centre=fit.centre)
    error = np.sqrt(np.diagonal(fit.eight.covariance))
    assert (np.abs(fit.eight.coefficients - truth.coefficients) < 3e-3 * error).all()
    assert fit.misfit.value < 1e-4
    assert fit.points == 16 * 11
    assert 1 < fit.independent_points < 0.25 * fit.points
    np.testing.assert_allclose(fit.six_at((50, 60))[0], truth.six_at(50, 60), atol=1e-4)


@pytest.mark.parametrize(("kind", "step", "count"), [("eight", 8, 60), ("eight", 16, 40), ("six", 8, 30)])
def test_standard_errors_of_correlated_points(kind, step, count):
    """Standardised errors have unit spread, and the misfit is 1 within its own error."""
    rng = np.random.default_rng(7)
    k = 8 if kind == "eight" else 6
    z, misfits, naive = [], [], []
    for _ in range(count):
        field = make_field(still, step=step, noise=smooth_noise(SHAPE, rng))
        fit = fit_region(field, (30, 30, 130, 110), coefficients=kind)
        z.append(fit.eight.coefficients[:k] / np.sqrt(np.diagonal(fit.eight.covariance)[:k]))
        misfits.append(fit.misfit.value)
        naive.append(fit.eight.coefficients[0] / (ERROR / math.sqrt(fit.points)))
    z = np.array(z)
    sampling = 1 / math.sqrt(2 * count)
    assert np.abs(z.mean(axis=0)).max() < 3.5 / math.sqrt(count)
    assert np.abs(z.std(axis=0) - 1).max() < 3.5 * sampling
    assert abs(math.sqrt((z**2).mean()) - 1) < 3 * sampling / math.sqrt(4)
    assert np.std(naive) > (2.5 if step == 8 else 1.3)  # what independent points would claim
    assert np.mean(misfits) == pytest.approx(1, abs=3.5 * fit.misfit.standard_error / math.sqrt(count))
    assert np.std(misfits) == pytest.approx(fit.misfit.standard_error, rel=3.5 * sampling + 0.05)


def test_a_denser_grid_says_hardly_more():
    dense = make_field(still, step=4)
    coarse = dense.isel(x=slice(None, None, 2), y=slice(None, None, 2))
    fits = [fit_region(field, (34, 34, 122, 106)) for field in (dense, coarse)]
    assert fits[0].points > 3.5 * fits[1].points
    errors = [np.sqrt(np.diagonal(fit.eight.covariance)) for fit in fits]
    np.testing.assert_allclose(errors[0], errors[1], rtol=0.2)  # of independent points: half


def test_independent_points_are_the_area_in_windows():
    fit = fit_region(make_field(still, shape=(600, 600)), None)
    assert fit.points == 75**2
    # the mean of n points has the variance of the smoothed noise's mean over the area, to edge effects
    assert fit.independent_points == pytest.approx(600**2 / 31**2, rel=0.1)


def test_rendered_pair_within_its_standard_errors():
    view = synth.PlaneInView(CAMERA, PLANE, MOTION)
    made = synth.pair(synth.Speckle(seed=1), view, SHAPE, sensor=synth.Sensor(noise=2, seed=2))
    fit = fit_region(sixflow.measure(made.frame0, made.frame1))
    truth = homography_flow(view.homography, centre=fit.centre)
    z = (fit.eight.coefficients - truth.coefficients) / np.sqrt(np.diagonal(fit.eight.covariance))
    assert np.abs(z).max() < 3.5
    assert fit.misfit.value == pytest.approx(1, abs=4 * fit.misfit.standard_error)


def test_six_and_eight_agree_for_an_affine_flow():
    motion = synth.Affine.from_six((1.0, -0.5, 0.03, 0.02, 0.01, -0.02), centre=(80, 70))
    field = make_field(lambda x, y: motion.six(x, y))
    eight, six = (fit_region(field, coefficients=kind) for kind in ("eight", "six"))
    np.testing.assert_allclose(six.eight.coefficients, eight.eight.coefficients, atol=1e-8)
    assert (six.eight.coefficients[6:] == 0).all()
    errors = [np.diagonal(fit.eight.covariance) for fit in (six, eight)]
    assert (errors[0][:6] <= errors[1][:6] * (1 + 1e-9)).all()


def test_points_that_failed_or_have_cut_windows_are_left_out():
    def flag(x, y):
        return np.where(x < 40, FLAGS["outlier"], np.where(x > 120, FLAGS["border"], 0)).astype(np.uint8)

    field = make_field(still, flag=flag)
    inner, with_border = fit_region(field), fit_region(field, border=True)
    assert inner.points == 17 * 10
    assert with_border.points == 17 * 15
    assert inner.centre[0] == 80.0
    assert with_border.centre[0] == 100.0
    masked = make_field(still)
    masked.covariance.values[0, 3, 3] = np.nan
    assert fit_region(masked).points == fit_region(make_field(still)).points - 1


def test_weights_follow_the_covariance():
    field = make_field(still)
    field.u.values[0, :, :10] = 1.0
    field.covariance.values[0, :, :10] *= 1e6
    fit = fit_region(field, coefficients="six")
    assert abs(fit.eight.coefficients[0]) < 0.01


def test_order_of_rows_and_pair_do_not_matter():
    view = plane_in_view(CAMERA, PLANE, MOTION)
    field = make_field(view)
    turned = field.isel(y=slice(None, None, -1), x=slice(None, None, -1))
    other = make_field(still)
    other["time"], other["frame0"] = ("time", [5.0]), ("time", [5])
    import xarray as xr

    both = xr.concat([other, field.assign_coords(time=[6.0])], "time", data_vars="minimal", join="outer")
    for found in (fit_region(turned), fit_region(both, time=1), fit_region(both, time=-1)):
        np.testing.assert_allclose(found.eight.coefficients, fit_region(field).eight.coefficients, atol=1e-9)


def test_two_motions_in_one_region_are_noticed():
    def six_at(x, y):
        return np.where((x < 80)[..., None], [0.1, 0, 0, 0, 0, 0], [-0.1, 0, 0, 0, 0, 0])

    calm = fit_region(make_field(still), (20, 20, 140, 120))
    fit = fit_region(make_field(six_at), (20, 20, 140, 120))
    assert fit.misfit.value > 10
    assert fit.assumptions[-1].startswith("NOT BORNE OUT")
    assert "NOT" not in calm.assumptions[-1]
    ratio = np.diagonal(fit.eight.covariance) / np.diagonal(calm.eight.covariance)
    assert (ratio > fit.misfit.value).all()  # what is left reaches further than noise does


def test_frame_interval_of_the_field_and_given():
    assert fit_region(make_field(still)).interval is None
    assert fit_region(make_field(still, frame_interval=0.04)).interval == 0.04
    assert fit_region(make_field(still, frame_interval=0.04), frame_interval=0.5).interval == 0.5


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"region": (0, 0, 10)}, "region="),
        ({"region": (50, 50, 40, 60)}, "x0 < x1"),
        ({"region": (500, 50, 600, 60)}, "outside the frame of 160×140"),
        ({"region": (0, 0, np.nan, 60)}, r"region\[2\]"),
        ({"region": "all"}, "region="),
        (
            {"region": (22, 22, 30, 30)},
            "1 of 1 points of the region can be used; a fit of eight coefficients",
        ),
        ({"region": (21, 21, 25, 25)}, "0 of 0 points"),
        ({"coefficients": "nine"}, "coefficients='nine'"),
        ({"time": 3}, "time=3"),
        ({"border": 1}, "border=1"),
        ({"frame_interval": 0}, "frame_interval=0"),
    ],
)
def test_bad_input(options, text):
    with pytest.raises(InputError, match=text):
        fit_region(make_field(still), **options)


def test_bad_fields():
    field = make_field(still)
    with pytest.raises(InputError, match="covariance"):
        fit_region(field.drop_vars("covariance"))
    with pytest.raises(InputError, match="window=None"):
        fit_region(field.assign_attrs(settings=json.dumps({})))
    with pytest.raises(InputError, match="frame_shape"):
        fit_region(field.assign_attrs(frame_shape=[]))
    with pytest.raises(InputError, match="field is a list"):
        fit_region([1, 2])
    with pytest.raises(InputError, match="positive definite"):
        fit_region(field.assign(covariance=field.covariance * 0))

    def all_failed(x, y):
        return np.full(x.shape, FLAGS["low_texture"], np.uint8)

    with pytest.raises(InputError, match=r"0 of 340 points of the region can be used \(340 failed\)"):
        fit_region(make_field(still, flag=all_failed))


def test_a_motion_that_no_plane_makes():
    def six_at(x, y):
        return np.stack([-3 * (x - 80), -3 * (y - 70), *[np.full(x.shape, s) for s in (-6.0, 0, 0, 0)]], -1)

    with pytest.raises(MeasurementError, match="does not move as a plane could"):
        fit_region(make_field(six_at))


# What the errors of points do not explain


def test_slow_deviations_are_not_taken_for_noise():
    """A region that moves otherwise by slow waves of the size of its noise: hardly more than noise by the misfit.

    Multiplied by the misfit, standard errors would be 3 times too small.
    """
    rng = np.random.default_rng(3)
    shape, z, said = (240, 280), [], 0
    for _ in range(12):
        noise = smooth_noise(shape, rng) + smooth_noise(shape, rng, sigma=30.0)
        fit = fit_region(make_field(still, shape=shape, noise=noise), (20, 20, 260, 220))
        z.append(fit.eight.coefficients / np.sqrt(np.diagonal(fit.eight.covariance)))
        said += "NOT BORNE OUT" in fit.assumptions[-1]
    # the eight of one fit hang together: as if of 4 independent numbers; a tenth for what chance leaves unseen
    assert math.sqrt(np.mean(np.square(z))) < 1.1 * (1 + 3 / math.sqrt(2 * 4 * len(z)))
    assert said > len(z) / 2


def test_what_windows_leave_out_averages_down_less_than_noise():
    """Of the same size as the noise, and of four times its length: sixteen times fewer independent points."""
    period = 2 * math.pi * 4 * SIGMA
    field = make_field(still, shape=(400, 400))
    variances = np.diagonal(field.covariance.values, axis1=-2, axis2=-1)
    with_bias = field.assign(
        bias=(("time", "y", "x", "param"), variances.copy()),
        resolution=(("time", "y", "x"), np.full(field.flag.shape, period)),
    )
    shift = [fit_region(one, None, coefficients="six").eight.covariance[0, 0] for one in (field, with_bias)]
    assert (shift[1] - shift[0]) / shift[0] == pytest.approx(
        16, rel=0.35
    )  # the region ends after a few lengths


def test_known_bias_is_no_misfit():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(20):
        noise = smooth_noise(SHAPE, rng) + smooth_noise(SHAPE, rng, sigma=2 * SIGMA)
        field = make_field(still, noise=noise)
        spread = ERROR**2 * np.diag([1, 1, *[1 / (2 * (2 * SIGMA) ** 2)] * 4])
        bias = np.diagonal(SIX_FROM_GRADIENT @ spread @ SIX_FROM_GRADIENT.T)
        fit = fit_region(
            field.assign(
                bias=(("time", "y", "x", "param"), np.broadcast_to(bias, (*field.flag.shape, 6)).copy()),
                resolution=(("time", "y", "x"), np.full(field.flag.shape, 2 * math.pi * 2 * SIGMA)),
            ),
            (30, 30, 130, 110),
        )
        found.append(fit.misfit.value)
    assert np.mean(found) == pytest.approx(1, abs=3.5 * fit.misfit.standard_error / math.sqrt(20))
