"""What the tests of interpretation share: fields of exact displacement and noise of known covariance, and fits."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.convention.flags import FLAGS
from sixflow.engine.window import window_sigma
from sixflow.field.dataset import build_field
from sixflow.interpretation import Estimate, RegionFit
from sixflow.interpretation.region import fit_region
from sixflow.scenes import Camera, Eight, homography_flow, homography_six, plane_homography
from sixflow.settings import Settings

WINDOW = 31.0
SIGMA = window_sigma(WINDOW)
ERROR = 0.006  # px, of u and v at a point
CAMERA = Camera(focal=400.0, centre=(79.5, 69.5))
SHAPE = (140, 160)


def covariance_of_point(error: float = ERROR):
    """Covariance of the six of a window on a uniform texture: gradients have error/(σ√2)."""
    spread = error**2 * np.diag([1, 1, *[1 / (2 * SIGMA**2)] * 4])
    return SIX_FROM_GRADIENT @ spread @ SIX_FROM_GRADIENT.T


def smooth_noise(shape, rng, sigma=SIGMA):
    """Errors of the six at every pixel of a uniform texture, (rows, columns, 6): smoothed noise and its derivatives."""
    parts = []
    for _ in range(2):
        white = rng.normal(size=shape) * 2 * np.sqrt(np.pi) * sigma * ERROR
        parts.append([gaussian_filter(white, sigma, order=k, mode="wrap") for k in ((0, 0), (0, 1), (1, 0))])
    (u, u_x, u_y), (v, v_x, v_y) = parts
    return np.stack([u, v, u_x, u_y, v_x, v_y], axis=-1) @ SIX_FROM_GRADIENT.T


def make_field(six_at, *, shape=SHAPE, step=8, noise=None, error=ERROR, flag=None, **settings):
    """A field of one pair: the six of `six_at(x, y)`, plus noise at every pixel, and the covariance of a point."""
    y, x = np.arange(step // 2, shape[0], step), np.arange(step // 2, shape[1], step)
    grid_x, grid_y = np.meshgrid(x.astype(float), y.astype(float))
    six = six_at(grid_x, grid_y)
    if noise is not None:
        six = six + noise[y][:, x]
    flags = np.zeros(grid_x.shape, np.uint8) if flag is None else flag(grid_x, grid_y)
    six = np.where(((flags & ~np.uint8(FLAGS["border"])) != 0)[..., None], np.nan, six)
    return build_field(
        six=six[None],
        covariance=np.broadcast_to(covariance_of_point(error), (1, *grid_x.shape, 6, 6)).copy(),
        residual=np.zeros((1, *grid_x.shape)),
        noise=np.ones((1, *grid_x.shape)),
        flag=flags[None],
        x=x,
        y=y,
        time=np.zeros(1),
        time_unit="frame",
        frame_numbers=[(0, 1)],
        attrs={
            "settings": Settings(**{"window": WINDOW, "step": step} | settings).to_json(),
            "frame_shape": list(shape),
        },
    )


def plane_in_view(camera, plane, motion, blur=SIGMA**2, h=0.5):
    """The six of a plane's displacement at points, with its mean under the window by differences: d + ½σ²∇²d."""
    H = plane_homography(camera, plane, motion)

    def six_at(x, y):
        six = homography_six(H, x, y)
        around = sum(homography_six(H, x + i, y + j) for i, j in ((h, 0), (-h, 0), (0, h), (0, -h)))
        six[..., :2] += blur / 2 * ((around - 4 * six) / h**2)[..., :2]
        return six

    return six_at


def exact_fit(camera, plane, motion, *, region=(0, 0, 159, 139), error=1e-6, interval=None, covariance=None):
    """The fit that an exact measurement of a whole region would give, with a covariance of the right shape."""
    field = make_field(lambda x, y: np.zeros((*x.shape, 6)), error=error)
    fit = fit_region(field, region)
    flow = homography_flow(plane_homography(camera, plane, motion), centre=fit.centre)
    spread = fit.eight.covariance if covariance is None else covariance
    return fit_of(flow.coefficients, spread, fit.centre, interval)


def fit_of(coefficients, covariance, centre, interval=None, kind="eight"):
    return RegionFit(
        assumptions=(),
        eight=Eight(coefficients, centre, covariance),
        coefficients=kind,
        region=(0.0, 0.0, 159.0, 139.0),
        points=100,
        independent_points=10.0,
        misfit=Estimate(1.0, 0.1),
        interval=interval,
    )
