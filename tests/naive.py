"""Slow, obviously right twins of the compiled kernels: dense matrices, direct sums and SciPy, in double precision."""

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import BSpline, CubicHermiteSpline
from scipy.ndimage import map_coordinates

DIFFERENCES = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])


def mirror(index, size):
    """Walk back and forth between the border samples."""
    while size > 1 and not 0 <= index < size:
        index = -index if index < 0 else 2 * (size - 1) - index
    return index if size > 1 else 0


def filter_matrix(half, size, pad):
    """Matrix that filters a line of `size` samples with mirrored borders, `pad` samples further on each side."""
    matrix = np.zeros((size + 2 * pad, size))
    for row in range(-pad, size + pad):
        for k in range(1 - len(half), len(half)):
            matrix[row + pad, mirror(row + k, size)] += half[abs(k)]
    return matrix


def filter_separable(image, half, pad=0, stride=1):
    down, across = (filter_matrix(half, size, pad) for size in image.shape)
    return (down @ image.astype(float) @ across.T)[::stride, ::stride]


def bspline(distance, degree):
    """B-spline of a degree, centred at 0."""
    basis = BSpline.basis_element(np.arange(degree + 2) - (degree + 1) / 2, extrapolate=False)
    return np.nan_to_num(basis(np.asarray(distance, float)))


def spline_coefficients(image, degree, pad):
    """Solve for the coefficients whose spline goes through every pixel of the extended image."""
    samples = bspline(np.arange((degree + 1) // 2), degree)
    image = extended(image)
    down, across = (np.linalg.inv(filter_matrix(samples, size, 0)) for size in image.shape)
    cut = slice(FAR - pad, pad - FAR)
    return (down @ image @ across.T)[cut, cut]


FAR = 60


def extended(image):
    """Image continued point-symmetrically about its border pixels, by more than the spline's memory."""
    return np.pad(image.astype(float), FAR, mode="reflect", reflect_type="odd")


def interpolate(image, x, y, degree):
    return map_coordinates(extended(image), [y + FAR, x + FAR], order=degree, mode="mirror")


def interpolation_noise(fraction, degree):
    """Variance of unit white noise interpolated at a fraction between pixels: Σ of the squared impulse response."""
    impulse = np.zeros(128)
    impulse[64] = 1
    response = map_coordinates(impulse, [np.arange(16, 112) + fraction], order=degree, mode="mirror")
    return float((response**2).sum())


def slopes(values, nodes, axis):
    if len(nodes) == 1:
        return np.zeros_like(values)
    return np.gradient(values, nodes, axis=axis, edge_order=2 if len(nodes) > 2 else 1)


def twist(maps, step):
    """Mean of ∂u_x/∂y and ∂u_y/∂x, and the same of v."""
    y, x = (step * np.arange(size, dtype=float) for size in maps.shape[1:])
    return np.stack([(slopes(maps[k], y, 0) + slopes(maps[k + 1], x, 1)) / 2 for k in (2, 4)])


def hermite_line(nodes, values, slope, wanted):
    """Cubic Hermite interpolant of one line; straight on beyond the outermost nodes."""
    inside = np.clip(wanted, nodes[0], nodes[-1])
    if len(nodes) == 1:
        return values[0] + (wanted - inside) * slope[0]
    spline = CubicHermiteSpline(nodes, values, slope)
    return spline(inside) + (wanted - inside) * spline(inside, 1)


def hermite_surface(nodes_x, nodes_y, value, slope_x, slope_y, x, y):
    """Hermite interpolant on the crossings of x and y: along y first, then along x."""
    mixed = (slopes(slope_x, nodes_y, 0) + slopes(slope_y, nodes_x, 1)) / 2
    columns = range(len(nodes_x))
    lines = np.stack([hermite_line(nodes_y, value[:, i], slope_y[:, i], y) for i in columns], axis=1)
    along = np.stack([hermite_line(nodes_y, slope_x[:, i], mixed[:, i], y) for i in columns], axis=1)
    return np.stack([hermite_line(nodes_x, lines[j], along[j], x) for j in range(len(y))])


def blend(maps, grid, shape):
    """Dense displacement (u, v) of the local affine maps of a grid (x0, y0, step)."""
    x0, y0, step = grid
    rows, columns = maps.shape[1:]
    nodes_x, nodes_y = x0 + step * np.arange(columns, dtype=float), y0 + step * np.arange(rows, dtype=float)
    y, x = (np.arange(size, dtype=float) for size in shape)
    return np.stack(
        [hermite_surface(nodes_x, nodes_y, maps[k], maps[2 + 2 * k], maps[3 + 2 * k], x, y) for k in range(2)]
    )


def differentiate(image, axis):
    """8th-order central difference; beyond the border the image goes on point-symmetrically."""
    image = np.moveaxis(image, axis, -1)
    width = image.shape[-1]

    def at(column):
        if column < 0:
            return 2 * image[..., 0] - image[..., -column]
        if column >= width:
            return 2 * image[..., -1] - image[..., 2 * (width - 1) - column]
        return image[..., column]

    out = np.zeros_like(image)
    for x in range(width):
        for d, weight in enumerate(DIFFERENCES, start=1):
            out[..., x] += weight * (at(x + d) - at(x - d))
    return np.moveaxis(out, -1, axis)


def in_moved_axes(gx, gy, u, v, plane):
    """F⁻ᵀ g, F by differences of the dense displacement, which is less the plane; g where F folds."""
    (u_y, u_x), (v_y, v_x) = np.gradient(u), np.gradient(v)
    F = np.array([[1 + plane[2] + u_x, plane[3] + u_y], [plane[4] + v_x, 1 + plane[5] + v_y]])
    F = np.moveaxis(F, (0, 1), (-2, -1))
    F = np.where((np.linalg.det(F) > 0.05)[..., None, None], F, np.eye(2))
    return np.moveaxis(
        np.linalg.solve(np.swapaxes(F, -1, -2), np.stack([gx, gy], -1)[..., None])[..., 0], -1, 0
    )


def _at(image, x, y, degree, valid):
    """Image at places; NaN outside of it, and where the pixel before them is not valid."""
    height, width = image.shape
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    if valid is not None:
        column = np.clip(np.floor(np.where(inside, x, 0)).astype(int), 0, width - 1)
        row = np.clip(np.floor(np.where(inside, y, 0)).astype(int), 0, height - 1)
        inside &= valid[row, column]
    return np.where(
        inside, interpolate(image, np.where(inside, x, 0), np.where(inside, y, 0), degree), np.nan
    )


def warp(
    reference,
    moved,
    maps,
    grid,
    plane,
    degree,
    total,
    noise,
    *,
    valid0=None,
    valid1=None,
    light=None,
    central=False,
):
    """Gradient, right-hand side, residual and warped frame of one pass; `maps` are less the plane.

    valid0, valid1: bool arrays or None; light: dense (gain, offset) or None; noise: function of the fraction;
    central: both frames are brought to the middle.
    """
    height, width = reference.shape
    y, x = np.mgrid[:height, :width].astype(float)
    u, v = blend(maps, grid, reference.shape)
    dx, dy = u + plane[0] + plane[2] * x + plane[3] * y, v + plane[1] + plane[4] * x + plane[5] * y
    share = 0.5 if central else 1.0

    def variance(part):
        to_x, to_y = x + part * dx, y + part * dy
        return noise(to_x - np.floor(to_x)) * noise(to_y - np.floor(to_y))

    warped = _at(moved, x + share * dx, y + share * dy, degree, valid1)
    if central:
        still, still_variance = _at(reference, x - dx / 2, y - dy / 2, degree, valid0), variance(-0.5)
    else:
        still, still_variance = reference if valid0 is None else np.where(valid0, reference, np.nan), 1
    lit = warped if light is None else (warped - light[1]) / light[0]
    r = lit - still
    mean = np.where(np.isnan(lit), still, np.where(np.isnan(still), lit, (still + lit) / 2))
    gx, gy = differentiate(mean, 1), differentiate(mean, 0)
    if not central:
        gx, gy = in_moved_axes(gx, gy, u, v, plane)
    r = np.where(np.isfinite(gx) & np.isfinite(gy), r, np.nan)
    known = np.isfinite(r)
    q = (gx * u + gy * v if total else 0) - r
    return {
        "gradient_x": np.where(known, gx, 0),
        "gradient_y": np.where(known, gy, 0),
        "right": np.where(known, q, 0),
        "residual": r * np.sqrt(2 / (still_variance + variance(share))),
        "warped": warped,
        "still": np.nan_to_num(still) if central else reference,
    }


def hat(t):
    return np.clip(1 - np.abs(t), 0, None)


def node_moments(product, order, lattice):
    """Moments of one image about every node, weighted by hats, X and Y in spacings; (rows, columns, moments)."""
    y, x = np.mgrid[: product.shape[0], : product.shape[1]].astype(float)
    out = []
    for j in range(lattice.rows):
        for i in range(lattice.columns):
            X = (x - lattice.x0 - i * lattice.spacing) / lattice.spacing
            Y = (y - lattice.y0 - j * lattice.spacing) / lattice.spacing
            w = hat(X) * hat(Y) * product
            out.append([(w * part).sum() for part in _orders(order + 1, X, Y)])
    return np.array(out).reshape(lattice.rows, lattice.columns, -1)


def hat_weights(sigma, size, first, spacing, point, power=1):
    """Weights of a line of pixels about a point: a Gaussian on nodes every `spacing` px, shared out by hats.

    Nodes count that are no further than 3.5 σ/√power and half a spacing. w^power, w of integral 1.
    """
    width = sigma / np.sqrt(power)
    variance = width**2 - (spacing**2 - 1) / 6
    x, weights = np.arange(size, dtype=float), np.zeros(size)
    for node in first + spacing * np.arange(-size - 20, 2 * size + 20):
        if abs(node - point) <= 3.5 * width + spacing / 2:
            gauss = np.exp(-((node - point) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)
            weights += gauss * hat((x - node) / spacing)
    return weights * (2 * np.sqrt(np.pi) * sigma) ** (1 - power)


def node_windows(products, orders, lattice, sigma, grid, power=1):
    """Window sums of products under the window that nodes make, product by product; (rows, columns, Σ moments)."""
    height, width = products[0].shape
    out = np.empty((*grid.shape, sum(len(_orders(order + 1, 0.0, 0.0)) for order in orders)))
    for j, i in np.ndindex(*grid.shape):
        across = hat_weights(sigma, width, lattice.x0, lattice.spacing, grid.x[i], power)
        down = hat_weights(sigma, height, lattice.y0, lattice.spacing, grid.y[j], power)
        Y, X = np.meshgrid(
            (np.arange(height) - grid.y[j]) / sigma, (np.arange(width) - grid.x[i]) / sigma, indexing="ij"
        )
        w = np.outer(down, across)
        out[j, i] = [
            (w * product * part).sum()
            for product, order in zip(products, orders, strict=True)
            for part in _orders(order + 1, X, Y)
        ]
    return out


def window(sigma, shape, x, y, power=1):
    """(w^power, X, Y) of the window at (x, y): a product of Gaussians cut at 3.5 σ/√power in each direction."""
    reach = np.ceil(3.5 * sigma / np.sqrt(power))
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(float)
    dx, dy = columns - x, rows - y
    w = np.exp(-(dx**2 + dy**2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)
    return np.where((abs(dx) <= reach) & (abs(dy) <= reach), w, 0) ** power, dx / sigma, dy / sigma


def each_window(sigma, shape, grid, size, power=1):
    x0, y0, step = grid
    for j in range(size[0]):
        for i in range(size[1]):
            yield j, i, *window(sigma, shape, x0 + i * step, y0 + j * step, power)


def _orders(count, X, Y):
    return [np.ones_like(X), X, Y, X * X, X * Y, Y * Y][: count * (count + 1) // 2]


def moments(products, orders, sigma, grid, size, power=1):
    """Window sums of each product times 1, X, Y (, X², XY, Y²), in a row; shape (rows, columns, Σ)."""
    out = [[[] for _ in range(size[1])] for _ in range(size[0])]
    for j, i, w, X, Y in each_window(sigma, products[0].shape, grid, size, power):
        for product, order in zip(products, orders, strict=True):
            out[j][i] += [(w * product * part).sum() for part in _orders(order, X, Y)]
    return np.array(out)


def jacobian(gx, gy, X, Y):
    return np.stack([gx, gx * X, gx * Y, gy, gy * X, gy * Y])


def symmetric(moments):
    """6×6 matrix of the 18 moments of g_x², g_x g_y, g_y²."""
    blocks = []
    for one, x, y, xx, xy, yy in np.asarray(moments, float)[:18].reshape(3, 6):
        blocks.append(np.array([[one, x, y], [x, xx, xy], [y, xy, yy]]))
    return np.block([[blocks[0], blocks[1]], [blocks[1], blocks[2]]])


def maps_of(theta, sigma):
    """(u, v, u_x, u_y, v_x, v_y) of θ = (u, σu_x, σu_y, v, σv_x, σv_y)."""
    return np.array(
        [theta[0], theta[3], theta[1] / sigma, theta[2] / sigma, theta[4] / sigma, theta[5] / sigma]
    )


def unknowns_of(maps, sigma):
    return np.array([maps[0], sigma * maps[2], sigma * maps[3], maps[1], sigma * maps[4], sigma * maps[5]])


def six_transform(sigma):
    """Matrix from θ to (u, v, divergence, curl, stretch, shear)."""
    columns = []
    for k in range(6):
        u, v, u_x, u_y, v_x, v_y = maps_of(np.eye(6)[k], sigma)
        columns.append([u, v, u_x + v_y, v_x - u_y, u_x - v_y, u_y + v_x])
    return np.array(columns).T


def feedback(rho):
    """Factors of the standard errors when the noise's share ties points to their neighbours."""

    def held(q):
        return np.exp(-q) / (1 + rho * (1 - np.exp(-q / 2))) ** 2

    return np.sqrt([quad(held, 0, 60)[0], quad(lambda q: q * held(q), 0, 60)[0]])


def covariance(normal, sandwich, gamma, rho, transform):
    """H̃⁻¹ meat H̃⁻¹ in the six numbers, with the noise's share out of H and its feedback on the errors."""
    bread = transform @ np.linalg.inv(symmetric(normal) - gamma * np.eye(6))
    displacement, gradient = feedback(np.clip(rho, 0, 4))
    bread *= np.array([displacement] * 2 + [gradient] * 4)[:, None]
    return bread @ symmetric(sandwich) @ bread.T


def texture(normal, gamma):
    """(signal-to-noise ratio of the weakest direction, noise share ρ)."""
    values = np.linalg.eigvalsh(symmetric(normal)[np.ix_([0, 3], [0, 3])]) - gamma
    ratio = values[0] / gamma if gamma > 0 else np.inf
    return (0.0 if values[0] <= 1e-4 * values.sum() else ratio), gamma / values.mean()


def median_outliers(maps, step, reach, floor, limit):
    rows, columns = maps.shape[1:]
    outlier = np.zeros((rows, columns), bool)
    for j, i in np.ndindex(rows, columns):
        for k in range(2):
            guesses = []
            for dj, di in [
                (a, b) for a in (-reach, 0, reach) for b in (-reach, 0, reach) if (a, b) != (0, 0)
            ]:
                if 0 <= j + dj < rows and 0 <= i + di < columns:
                    there = maps[:, j + dj, i + di]
                    guesses.append(there[k] - step * (there[2 + 2 * k] * di + there[3 + 2 * k] * dj))
            guesses = np.array(guesses)[np.isfinite(guesses)]
            if len(guesses) >= 3 and np.isfinite(maps[0, j, i]):
                middle = np.median(guesses)
                spread = np.median(abs(guesses - middle))
                outlier[j, i] |= abs(maps[k, j, i] - middle) > limit * (spread + floor[j, i])
    return outlier


def window_sums(product, sigma, x, y, power=1):
    """Moments 1, X, Y, X², XY, Y² of one image under windows at the crossings of x and y; (rows, columns, 6)."""
    matrices = []
    for size, centres in zip(product.shape, (y, x), strict=True):
        scaled = (np.arange(size) - np.asarray(centres)[:, None]) / sigma
        w = np.exp(-(scaled**2) / 2) / (np.sqrt(2 * np.pi) * sigma)
        w = np.where(abs(scaled * sigma) <= np.ceil(3.5 * sigma / np.sqrt(power)), w, 0) ** power
        matrices.append([w * scaled**k for k in range(3)])
    down, across = matrices
    orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    return np.stack([down[b] @ product @ across[a].T for a, b in orders], axis=-1)


def cramer_rao(gx, gy, sigma, x, y, noise):
    """Smallest covariance of the six under a weighted window: H⁻¹ (Σ w² 2 noise² J Jᵀ) H⁻¹."""
    products = gx * gx, gx * gy, gy * gy
    normal = np.concatenate([window_sums(p, sigma, x, y) for p in products], axis=-1)
    meat = np.concatenate([window_sums(2 * noise**2 * p, sigma, x, y, 2) for p in products], axis=-1)
    out = np.empty((len(y), len(x), 6, 6))
    for at in np.ndindex(*out.shape[:2]):
        bread = six_transform(sigma) @ np.linalg.inv(symmetric(normal[at]))
        out[at] = bread @ symmetric(meat[at]) @ bread.T
    return out


def patch(image, x, y, radius):
    """Square neighbourhood of a pixel; 0 beyond the border."""
    return np.pad(image, radius)[y : y + 2 * radius + 1, x : x + 2 * radius + 1]


def folded(image, x, y, radius):
    """p(o) + p(−o) and p(o) − p(−o) of a patch, row by row up to its centre."""
    p = patch(image, x, y, radius)
    half = slice(p.size // 2 + 1)
    return (p + p[::-1, ::-1]).ravel()[half], (p - p[::-1, ::-1]).ravel()[half]


def shifted(d_x, d_y):
    """M(d), (1, X_p, Y_p) = (1, X_q, Y_q) M(d) with X_p = X_q + d_x, for u and for v."""
    return np.kron(np.eye(2), np.array([[1, d_x, d_y], [0, 1, 0], [0, 0, 1]]))


def pool_weight(d_x, d_y, width):
    """A Gaussian cut at 3.5 widths in each direction."""
    inside = abs(d_x) <= 3.5 * width and abs(d_y) <= 3.5 * width
    return np.exp(-(d_x**2 + d_y**2) / (2 * width**2)) / (2 * np.pi * width**2) if inside else 0.0


def pool(values, lattice, grid, width, length, delta=None):
    """Σ_q w M(d)ᵀ V_q [M(d)] of vectors, or of matrices, about every grid point; shape (rows, columns, …).

    w = w(q − p), or w(q − p) w(q + δ − p).
    """
    out = np.zeros((*grid.shape, *values.shape[2:]))
    for j, i in np.ndindex(*grid.shape):
        for b, a in np.ndindex(*lattice.shape):
            d_x, d_y = lattice.x[a] - grid.x[i], lattice.y[b] - grid.y[j]
            w = pool_weight(d_x, d_y, width)
            if delta is not None:
                w *= pool_weight(d_x + delta[0] * lattice.step, d_y + delta[1] * lattice.step, width)
            M = shifted(d_x / length, d_y / length)
            seen = M.T @ values[b, a]
            out[j, i] += w * (seen if seen.ndim == 1 else seen @ M)
    return out


def walk_scan(bits, blocks, units, words, limits, first, last, shift):
    """Number of bits (of a string of 0 and 1) that the blocks of a JPEG scan use, or the exception of what is wrong.

    `words[component][kind]` is a dictionary from code words to symbols.
    """
    left, run, mean = list(bits[::-1]), 0, [0] * len(limits)

    def code(table):
        word = ""
        while word not in table:
            word += left.pop()
            if len(word) > 16:
                raise KeyError(word)
        return table[word]

    def number(length):
        return int("".join(left.pop() for _ in range(length)) or "0", 2)

    for _ in range(units):
        for component in blocks:
            place = first
            if first == 0:
                length = code(words[component][0])
                value = number(length)
                is_positive = not length or value >> (length - 1)
                mean[component] += (value if is_positive else value + 1 - 2**length) << shift
                if abs(mean[component]) > limits[component]:
                    raise OverflowError
                place = 1
            if run:
                run -= 1
                continue
            while place <= last:
                skipped, length = divmod(code(words[component][1]), 16)
                if length == 0 and skipped < 15:
                    run = 2**skipped - 1 + number(skipped)
                    break
                place += skipped + 1
                number(length)
                if place > last + 1:
                    raise IndexError
    return len(bits) - len(left)
