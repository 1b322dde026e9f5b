"""Projection of a bank, pooling, and the equations of every operator of an array, against direct sums."""

import numpy as np
import pytest
from scipy.signal import correlate

import naive
from sixflow.eigenfilters.array import Images, gradient_factor, local_equations, products
from sixflow.eigenfilters.bank import THRESHOLD, FilterBank
from sixflow.eigenfilters.default import array_bank, array_spacing
from sixflow.eigenfilters.kernels import Gabor
from sixflow.eigenfilters.pool import Pool, shifted
from sixflow.eigenfilters.problem import EigenfilterProblem, OperatorArray
from sixflow.eigenfilters.projection import Projection
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.window import window_sigma
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.problem import State
from sixflow.synth import Affine, Speckle, pair
from solved import plan_of

DTYPES = [np.float32, np.float64]
LENGTH = 5.0


@pytest.fixture(scope="module")
def projection():
    """Of the smallest array: 13 × 13 px."""
    return Projection(array_bank(10), LENGTH, np.float64)


def coordinates(radius, length=1.0):
    """X, Y of the pixels of a patch, row by row."""
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1] / length
    return x.ravel(), y.ravel()


class TestProjection:
    def test_rows_are_orthonormal(self, projection):
        np.testing.assert_allclose(projection.rows @ projection.rows.T, np.eye(len(projection)), atol=1e-10)

    def test_rows_are_even_or_odd(self, projection):
        signs = np.where(np.arange(len(projection)) < projection.even, 1, -1)
        assert 0 < projection.even < len(projection)
        np.testing.assert_allclose(projection.rows[:, ::-1], signs[:, None] * projection.rows, atol=1e-12)

    def test_brightness_its_slope_and_its_curvature_are_not_seen(self, projection):
        x, y = coordinates(projection.radius, projection.radius)
        surfaces = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        np.testing.assert_allclose(projection.rows @ surfaces, 0, atol=1e-10)

    def test_rows_span_the_bank(self, projection):
        R = np.concatenate([projection.bank.matrix.real, projection.bank.matrix.imag])
        x, y = coordinates(projection.radius)
        smooth, _ = np.linalg.qr(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1))
        R = R - (R @ smooth) @ smooth.T
        S = projection.rows
        missed = np.linalg.norm(R - (R @ S.T) @ S, 2) ** 2
        assert missed < THRESHOLD * np.linalg.norm(R, 2) ** 2
        np.testing.assert_allclose(S @ smooth, 0, atol=1e-10)

    @pytest.mark.parametrize("dtype", DTYPES)
    @pytest.mark.parametrize("window", [10, 31])
    def test_moments_are_the_products_with_weighted_patches(self, dtype, window):
        projection = Projection(array_bank(window), LENGTH, dtype)
        side = 2 * projection.radius + 1
        patches = np.random.default_rng(1).normal(size=(7, side, side)).astype(dtype)
        plus, minus = (
            np.stack(part)
            for part in zip(*(naive.folded(p, side // 2, side // 2, side // 2) for p in patches), strict=True)
        )
        x, y = coordinates(projection.radius, LENGTH)
        flat = patches.reshape(7, -1).astype(float)
        exact = np.stack([(flat * factor) @ projection.rows.T for factor in (np.ones_like(x), x, y)], axis=1)
        found = projection.moments((plus, minus))
        assert found.dtype == projection.responses((plus, minus)).dtype == dtype
        # rounding of sums of n² terms of unit rows and patches
        limit = 4 * np.finfo(dtype).eps * side * max(1, abs(x).max())
        np.testing.assert_allclose(found, exact, atol=limit)
        np.testing.assert_allclose(projection.responses((plus, minus)), exact[:, 0], atol=limit)

    def test_power_of_noise_on_part_of_a_patch(self, projection):
        side = 2 * projection.radius + 1
        counted = np.random.default_rng(2).random((side, side)) > 0.3
        folded = naive.folded(counted.astype(float), side // 2, side // 2, side // 2)
        seen = projection.seen(tuple(part[None] for part in folded))
        S = projection.rows[:, counted.ravel()]
        assert seen[0] == pytest.approx(np.trace(S @ S.T))
        whole = naive.folded(np.ones((side, side)), side // 2, side // 2, side // 2)
        assert projection.seen(tuple(part[None] for part in whole))[0] == pytest.approx(len(projection))

    @pytest.mark.parametrize("shift", [(0, 0), (3, 0), (0, -4), (5, 6), (-12, 2), (13, 0), (0, -30)])
    def test_overlap(self, projection, shift):
        """Rows laid on one canvas about two points; noise of unit variance in every pixel of it."""
        n, margin = 2 * projection.radius + 1, 30
        images = np.pad(projection.rows.reshape(-1, n, n), ((0, 0), (margin, margin), (margin, margin)))
        there = np.roll(images, (shift[1], shift[0]), (1, 2))
        exact = images.reshape(len(images), -1) @ there.reshape(len(images), -1).T
        np.testing.assert_allclose(projection.overlap(*shift), exact, atol=1e-12)

    def test_overlap_is_the_covariance_of_noise(self, projection):
        n, count, (dx, dy) = 2 * projection.radius + 1, 4000, (3, -2)
        noise = np.random.default_rng(3).normal(size=(count, n + 2, n + 3))
        here = noise[:, 2:, :n].reshape(count, -1) @ projection.rows.T
        there = noise[:, :n, dx:].reshape(count, -1) @ projection.rows.T
        assert dy == -2
        # each of m² means of products of unit normals is known to 1/√count or better; 5.5 for the largest of 3000
        np.testing.assert_allclose(
            here.T @ there / count, projection.overlap(dx, dy), atol=5.5 * 2**0.5 / count**0.5
        )

    def test_extent_is_where_the_motion_of_blobs_is_seen(self, projection):
        x, y = coordinates(projection.radius)
        r2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
        C = (1 - r2 / 4) * np.exp(-r2 / 4)  # of the gradient of blobs of σ = 1 px
        weight = np.einsum("jx,xy,jy->x", projection.rows, C, projection.rows)
        square = np.average((x * x + y * y) / 2, weights=weight)
        assert projection.extent == pytest.approx(np.sqrt(square), rel=1e-3)  # pixels cut the power off at π

    def test_frame_constant_is_a_sum_over_overlaps(self, projection):
        """∫P²/∫P is Σ_δ ρ(δ)²/ρ(0), ρ(δ) the trace of the overlap at δ."""
        n = 2 * projection.radius + 1
        rho = sum(correlate(row, row, method="direct") for row in projection.rows.reshape(-1, n, n))
        exact = (rho**2).sum() / rho[n - 1, n - 1]
        assert projection.frame_constant(1) == pytest.approx(exact, rel=1e-12)
        assert projection.frame_constant(3) == pytest.approx(exact / 9, rel=1e-12)

    def test_frame_constant_of_a_pattern(self, projection):
        """Every response of a periodic pattern that has the bank's own spectrum, and a random phase."""
        side, n = 96, 2 * projection.radius + 1
        power = (abs(np.fft.fft2(projection.rows.reshape(-1, n, n), (side, side))) ** 2).sum(axis=0)
        white = np.fft.fft2(np.random.default_rng(4).normal(size=(side, side)))
        pattern = np.fft.ifft2(np.sqrt(power) * white / abs(white)).real
        around = np.pad(pattern, projection.radius, mode="wrap")
        patches = np.lib.stride_tricks.sliding_window_view(around, (n, n)).reshape(side**2, -1)
        seen = ((patches @ projection.rows.T) ** 2).sum() / (pattern**2).sum()
        assert projection.frame_constant(1) == pytest.approx(seen, rel=1e-10)

    def test_noise_of_the_gradient(self, projection):
        """The design of one bright pixel, summed over all pixels that a gradient in the patch may see."""
        reach, radius = len(DERIVATIVE), projection.radius
        assert tuple(naive.DIFFERENCES) == pytest.approx(DERIVATIVE)
        x, y = coordinates(radius, LENGTH)
        inner = slice(2 * reach, -2 * reach)  # far from the border, where differences are extended
        size = 2 * (radius + 2 * reach) + 1
        total = np.zeros((6, 6))
        for j, i in np.ndindex(size - 2 * reach, size - 2 * reach):
            image = np.zeros((size, size))
            image[j + reach, i + reach] = 1
            gx, gy = (naive.differentiate(image, axis)[inner, inner].ravel() for axis in (1, 0))
            D = projection.rows @ np.stack([gx, gx * x, gx * y, gy, gy * x, gy * y], axis=1)
            total += D.T @ D
        np.testing.assert_allclose(projection.gradient_noise(DERIVATIVE), total, atol=1e-10)


@pytest.mark.parametrize("window", [10, 10.5, 13, 17, 20, 23.3, 31, 60, 400])
def test_an_array_for_every_window(window):
    """Operators are smaller than the window, stand within two of their extents, and overlap with few others."""
    array = OperatorArray(window, np.dtype(np.float32))
    sigma, spacing = window_sigma(window), array.spacing
    assert array.projection.extent < sigma
    assert array.width**2 + array.projection.extent**2 == pytest.approx(sigma**2)
    assert spacing == array_spacing(window) <= 2 * array.projection.extent
    assert array.freedom == len(array.projection) - 3 > 30
    # further ones have no more in common than a tenth of their noise's power, whatever the pair of responses
    for dx, dy in ((3, 0), (2, 2), (0, 3)):
        beyond = array.projection.overlap(dx * spacing, dy * spacing)
        assert (beyond**2).sum() < 0.1 * len(array.projection)


POOLS = [
    (Grid.over((40, 57), 6), Grid.over((40, 57), 8), 5.3),  # fewer taps than positions
    (Grid.over((9, 30), 4), Grid.over((9, 30), 1), 7.0),  # more taps than rows
    (Grid.over((1, 1), 4), Grid.over((1, 1), 3), 2.0),
    (Grid.over((33, 21), 3), Grid.over((33, 21), 16), 1.68),
]


class TestPool:
    @staticmethod
    def values(lattice, *shape):
        return np.random.default_rng(5).normal(size=(*lattice.shape, *shape))

    def test_shift_of_the_design(self):
        rng = np.random.default_rng(6)
        x, y, gx, gy = rng.normal(size=(4, 50))
        d_x, d_y = 0.7, -1.3

        def design(x, y):
            return np.stack([gx, gx * x, gx * y, gy, gy * x, gy * y], axis=1)

        np.testing.assert_allclose(design(x, y) @ shifted(d_x, d_y), design(x + d_x, y + d_y), atol=1e-12)
        np.testing.assert_allclose(shifted(d_x, d_y), naive.shifted(d_x, d_y))
        np.testing.assert_allclose(shifted(0.2, 0.3) @ shifted(0.5, -1.6), shifted(0.7, -1.3), atol=1e-15)

    @pytest.mark.parametrize(("lattice", "grid", "width"), POOLS)
    def test_sums(self, lattice, grid, width):
        pool = Pool(lattice, grid, width, LENGTH)
        vectors, matrices = self.values(lattice, 6), self.values(lattice, 6, 6)
        np.testing.assert_allclose(
            pool.vectors(vectors), naive.pool(vectors, lattice, grid, width, LENGTH), atol=1e-12
        )
        np.testing.assert_allclose(
            pool.matrices(matrices), naive.pool(matrices, lattice, grid, width, LENGTH), atol=1e-12
        )
        only_level = np.zeros_like(vectors)
        only_level[..., 0] = vectors[..., 0]
        level = naive.pool(only_level, lattice, grid, width, LENGTH)[..., 0]
        np.testing.assert_allclose(pool.scalars(vectors[..., 0]), level, atol=1e-12)

    @pytest.mark.parametrize("delta", [(0, 0), (1, 0), (-1, 2), (2, 2)])
    @pytest.mark.parametrize(("lattice", "grid", "width"), POOLS[:2])
    def test_pairs(self, lattice, grid, width, delta):
        values = self.values(lattice, 6, 6)
        exact = naive.pool(values, lattice, grid, width, LENGTH, delta)
        np.testing.assert_allclose(Pool(lattice, grid, width, LENGTH).pairs(values, delta), exact, atol=1e-12)

    def test_pairs_of_correlated_vectors(self):
        """The covariance of the pooled sum of noise that neighbours share, by drawing it."""
        lattice, grid, width, delta = Grid.over((20, 26), 5), Grid.over((20, 26), 9), 4.0, (1, 0)
        pool, design = Pool(lattice, grid, width, LENGTH), self.values(lattice, 6, 3)
        flat = design.reshape(-1, 6, 3)
        K = np.array([[0.6, 0.1, 0.0], [0.0, 0.5, 0.2], [-0.1, 0.0, 0.4]])
        covariance = pool.pairs(products(flat, flat, lattice), (0, 0))
        one_way = pool.pairs(products(flat @ K, flat, lattice, delta) @ shifted(5 / LENGTH, 0), delta)
        covariance += one_way + np.swapaxes(one_way, -1, -2)
        exact = np.zeros((*grid.shape, 6, 6))
        weight = {}
        for q in np.ndindex(*lattice.shape):
            place = np.zeros((*lattice.shape, 3, 6))
            place[q] = design[q].T
            rows = [naive.pool(place[..., k, :], lattice, grid, width, LENGTH) for k in range(3)]
            weight[q] = np.stack(rows, axis=-1)  # (rows, columns, 6, 3): what noise at q does
        for (j, i), w in weight.items():
            exact += w @ np.swapaxes(w, -1, -2)
            if (j, i + 1) in weight:
                cross = w @ K @ np.swapaxes(weight[j, i + 1], -1, -2)
                exact += cross + np.swapaxes(cross, -1, -2)
        np.testing.assert_allclose(covariance, exact, atol=1e-12)

    @pytest.mark.parametrize(("lattice", "grid", "width"), POOLS[:2])
    def test_one_affine_map_is_found_everywhere(self, lattice, grid, width):
        """Whatever is cut off by the border: sums of matrices and of vectors have the same weights."""
        plane = np.array([0.3, -0.2, 0.02, -0.01, 0.03, 0.04])

        def unknowns(points):
            u, v, u_x, u_y, v_x, v_y = points.plane(plane)
            return np.stack([u, LENGTH * u_x, LENGTH * u_y, v, LENGTH * v_x, LENGTH * v_y], axis=-1)

        root = self.values(lattice, 6, 9)
        normal = root @ np.swapaxes(root, -1, -2)
        right = (normal @ unknowns(lattice)[..., None])[..., 0]
        pool = Pool(lattice, grid, width, LENGTH)
        found = np.linalg.solve(pool.matrices(normal), pool.vectors(right)[..., None])[..., 0]
        np.testing.assert_allclose(found, unknowns(grid), atol=1e-9)


def test_noise_that_operators_share():
    """The covariance of the pooled sum against that of all pairs of operators, near and far."""
    shape, window = (64, 70), 21
    made = pair(Speckle(seed=2), Affine.translation(0.3, -0.2), shape)
    frames = [Frame(frame - 128, NO_MASK) for frame in (made.frame0, made.frame1)]
    grid = Grid.over(shape, 30)
    problem = EigenfilterProblem(*frames, grid, plan_of(shape, method="eigenfilter", window=window))
    equations = problem.step(np.zeros((6, *grid.shape)), State()).equations
    lattice, array = problem.pool.lattice, problem.array
    design = equations.design.reshape(*lattice.shape, 6, -1)
    noise = np.random.default_rng(8).uniform(0.5, 2, lattice.shape)
    found = problem._correlated(equations.design, noise)
    near = {(0, 0), *array.overlaps, *((-dx, -dy) for dx, dy in array.overlaps)}
    sigma = window_sigma(window)
    for j, i in np.ndindex(*grid.shape):
        seen = {}  # what the noise of every operator does to the sum at the point
        for q in np.ndindex(*lattice.shape):
            d_x, d_y = lattice.x[q[1]] - grid.x[i], lattice.y[q[0]] - grid.y[j]
            weight = naive.pool_weight(d_x, d_y, array.width) * noise[q]
            if weight:
                seen[q] = weight * naive.shifted(d_x / sigma, d_y / sigma).T @ design[q]
        exact, every = np.zeros((6, 6)), np.zeros((6, 6))
        for (y, x), one in seen.items():
            for (b, a), other in seen.items():
                K = array.projection.overlap((a - x) * lattice.step, (b - y) * lattice.step)
                every += one @ K @ other.T
                exact += one @ K @ other.T if (a - x, b - y) in near else 0
        np.testing.assert_allclose(found[j, i], exact, atol=1e-6 * np.abs(exact).max())
        # further ones would change no standard error by more
        np.testing.assert_allclose(np.sqrt(np.diagonal(every) / np.diagonal(exact)), 1, atol=0.05)


SHAPE, SPACING = (37, 44), 5


@pytest.fixture(scope="module")
def images():
    """Random images, with missing pixels, a change of contrast and of brightness."""
    rng = np.random.default_rng(7)
    counted = rng.random(SHAPE) > 0.01
    counted[20:29, 24:31] = False
    counted[:, 42:] = False
    gx, gy, q, noise = rng.normal(size=(4, *SHAPE))
    mean = naive.filter_separable(rng.normal(size=SHAPE), [0.4, 0.3]) + 2
    residual = 0.2 * noise + 0.3 * mean - 0.7
    return [np.where(counted, image, 0) for image in (gx, gy, q, residual, mean)] + [counted]


def naive_position(projection, images, x, y):
    """(D, z, s, C, B) of one position: B only where a part of the patch is missing."""
    gx, gy, q, r, mean, counted = (naive.patch(i, x, y, projection.radius).ravel() for i in images)
    X, Y = coordinates(projection.radius, LENGTH)
    S = projection.rows
    D = S @ np.stack([gx, gx * X, gx * Y, gy, gy * X, gy * Y], axis=1)
    C = S @ np.stack([mean, mean * X, mean * Y], axis=1)
    B = (
        S @ np.stack([counted, counted * X, counted * Y], axis=1)
        if not counted.all()
        else np.zeros((len(S), 0))
    )
    return D, S @ q, S @ r, C, B


def without(nuisance, columns):
    """What the nuisance columns leave of others."""
    return columns - nuisance @ (np.linalg.pinv(nuisance, 1e-9) @ columns)


@pytest.mark.parametrize("dtype", DTYPES)
def test_least_squares_with_nuisances(images, dtype):
    projection = Projection(array_bank(10), LENGTH, dtype)
    lattice = Grid.over(SHAPE, SPACING)
    *frames, counted = images
    found = local_equations(projection, lattice, Images(*(f.astype(dtype) for f in frames), counted))
    assert found.design.dtype == dtype
    whole = cut = 0
    for j, i in np.ndindex(*lattice.shape):
        D, z, s, C, B = naive_position(projection, images, lattice.x[i], lattice.y[j])
        c, seen = (without(B, part[:, None])[:, 0] if B.size else part for part in (C[:, 0], s))
        share = c @ seen / (c @ c)
        kappa = 1 - (np.clip(share, -1, 1) / 2) ** 2
        nuisance = np.concatenate([B, C], axis=1)
        plain, D = D, kappa * without(nuisance, D)
        target = kappa * z + (kappa - 1) * s
        left = without(nuisance, s[:, None])[:, 0]
        power = left @ left + (2 * max(abs(share) - 1, 0)) ** 2 * (c @ c)
        limit = 40 * np.finfo(dtype).eps * len(D) if dtype == np.float32 else 1e-8
        size = (abs(plain) ** 2).sum()
        np.testing.assert_allclose(found.normal[j, i], D.T @ D, atol=limit * size)
        np.testing.assert_allclose(
            found.right[j, i], D.T @ target, atol=limit * np.sqrt(size) * np.linalg.norm(target)
        )
        np.testing.assert_allclose(found.power[j, i], power, rtol=limit, atol=limit * (s @ s))
        np.testing.assert_allclose(found.contrast[j, i], c @ c, rtol=limit, atol=limit * (C[:, 0] @ C[:, 0]))
        missing = B.size > 0
        S = projection.rows[:, naive.patch(counted, lattice.x[i], lattice.y[j], projection.radius).ravel()]
        assert found.freedom[j, i] == pytest.approx(max((S**2).sum() - (6 if missing else 3), 1), rel=1e-5)
        if dtype == np.float64 and np.linalg.cond(D.T @ D) < 1e6:
            columns = np.concatenate([kappa * plain, C, B], axis=1)
            theta = np.linalg.lstsq(columns, target, rcond=None)[0][:6]
            np.testing.assert_allclose(
                np.linalg.solve(found.normal[j, i], found.right[j, i]), theta, atol=1e-7
            )
            whole, cut = whole + (not missing), cut + missing
    if dtype == np.float64:
        assert whole > 3
        assert cut > 30


def test_nothing_to_see():
    projection, lattice = Projection(array_bank(10), LENGTH), Grid.over((20, 20), 5)
    zero = np.zeros((20, 20), np.float32)
    for counted in (np.ones((20, 20), bool), np.zeros((20, 20), bool)):
        found = local_equations(projection, lattice, Images(zero, zero, zero, zero, zero, counted))
        for part in (found.normal, found.right, found.power, found.contrast):
            np.testing.assert_array_equal(part, 0)
        assert (found.freedom >= 1).all()


def still_and_moved(contrast, shift):
    """Gradient, residual and mean frame of a pattern that moved by (shift, 0) and changed its contrast."""
    made = pair(Speckle(sigma=1.5, seed=1), Affine.translation(shift, 0), (60, 60))
    I0, I1 = made.frame0 - 128, contrast * (made.frame1 - 128)
    mean = (I0 + I1) / 2
    return naive.differentiate(mean, 1), naive.differentiate(mean, 0), I1 - I0, mean


@pytest.mark.parametrize("contrast", [0.4, 0.5, 0.8, 1.0, 1.3, 2.0, 2.9])
def test_kappa(contrast):
    """Taking out a change of contrast takes the share 1 − κ of the motion with it; κ brings it back."""
    projection, lattice, shift = Projection(array_bank(21), LENGTH, np.float64), Grid.over((60, 60), 8), 0.02
    gx, gy, r, mean = still_and_moved(contrast, shift)
    counted = np.ones_like(r, bool)
    found = local_equations(projection, lattice, Images(gx, gy, -r, r, mean, counted))
    theta = np.linalg.solve(found.normal.sum(axis=(0, 1)), found.right.sum(axis=(0, 1)))
    # second order in the shift over the shortest wave that the pattern has, (2π shift/5)²
    assert theta[0] == pytest.approx(shift, rel=2e-3)
    assert theta[3] == pytest.approx(0, abs=2e-3 * shift)
    folded = [
        np.array([[part] for part in naive.folded(image, 30, 30, projection.radius)]) for image in (mean, r)
    ]
    seen, of_residual = (projection.responses(tuple(f)) for f in folded)
    assert gradient_factor(seen, of_residual)[0] == pytest.approx(
        4 * contrast / (1 + contrast) ** 2, abs=0.02
    )


@pytest.mark.parametrize("contrast", [0.0, 0.05, 10.0])
def test_texture_that_is_in_one_frame_only_is_no_change_of_light(contrast):
    projection, lattice = Projection(array_bank(21), LENGTH, np.float64), Grid.over((60, 60), 8)
    gx, gy, r, mean = still_and_moved(contrast, 0.0)
    found = local_equations(projection, lattice, Images(gx, gy, -r, r, mean, np.ones_like(r, bool)))
    # the zero-normalised residual of frames that have nothing in common is √2; of no light that changed it is 0
    assert (np.sqrt(found.power / found.contrast) > 1.2).all()


def test_few_kernels_do_as_well():
    """Any bank can be projected; even and odd rows come from the two parts of complex kernels."""
    bank = FilterBank((Gabor(0.8, sigma=3), Gabor(0.8, 1.57, sigma=3)), 9)
    projection = Projection(bank, 3.0, np.float64)
    assert (len(projection), projection.even) == (4, 2)
