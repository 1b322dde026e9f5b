"""One-parameter groups against Eagleson's eq. (4), and their picture."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from sixflow import groups
from sixflow.eigenfilters.generators import BY_NAME
from sixflow.errors import FieldFileError, InputError
from sixflow.groups import (
    AFFINE,
    EUCLIDEAN,
    GROUPS,
    PROJECTIVE,
    SIMILARITY,
    TRANSLATION,
    draw_trajectories,
    trajectory,
)

POINTS = np.random.default_rng(0).uniform(-2, 2, (20, 2))
TIMES = np.linspace(-0.4, 0.4, 9)
COSH, SINH, COS, SIN, EXP = np.cosh, np.sinh, np.cos, np.sin, np.exp
PATHS = {
    "L_x": lambda t, x, y: (x + t, y + 0 * t),
    "L_y": lambda t, x, y: (x + 0 * t, y + t),
    "L_s": lambda t, x, y: (x * EXP(t), y * EXP(t)),
    "L_r": lambda t, x, y: (x * COS(t) - y * SIN(t), x * SIN(t) + y * COS(t)),
    "L_b": lambda t, x, y: (x * EXP(t), y * EXP(-t)),
    "L_B": lambda t, x, y: (x * COSH(t) + y * SINH(t), x * SINH(t) + y * COSH(t)),
    "L_E": lambda t, x, y: (x / (1 - t * x), y / (1 - t * x)),
    "L_F": lambda t, x, y: (x / (1 - t * y), y / (1 - t * y)),
}


@pytest.mark.parametrize("group", GROUPS.values(), ids=str)
def test_trajectories_of_the_generators(group):
    for symbol, tau in zip(group.symbols, np.eye(group.dimension), strict=True):
        want = np.stack(PATHS[symbol](TIMES, *POINTS.T[..., None]), axis=-1)
        found = trajectory(group, tau, POINTS, TIMES)
        np.testing.assert_allclose(found, want, rtol=1e-13, atol=1e-14, err_msg=symbol)


def test_eigenfilters_have_the_same_trajectories():
    for symbol, tau in zip(AFFINE.symbols, np.eye(6), strict=True):
        want = np.stack(BY_NAME[symbol].flow(0.3, *POINTS.T), axis=-1)
        np.testing.assert_allclose(trajectory(AFFINE, tau, POINTS, [0.3])[:, 0], want, rtol=0, atol=1e-14)


def test_shapes_are_broadcast():
    tau = np.random.default_rng(1).normal(0, 0.1, (4, 1, 8))
    found = trajectory(PROJECTIVE, tau, POINTS, TIMES)
    assert found.shape == (4, 20, 9, 2)
    np.testing.assert_allclose(found[:, :, 4], np.broadcast_to(POINTS, (4, 20, 2)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        found[2, 3], trajectory(PROJECTIVE, tau[2, 0], POINTS[3], TIMES), rtol=0, atol=1e-14
    )
    assert trajectory(EUCLIDEAN, [0, 0, 1], [1, 2], []).shape == (0, 2)


def test_trajectories_through_infinity():
    fan = np.eye(8)[6]
    with pytest.raises(InputError, match=r"points: 1 of 3 elements taken to infinity .*index \(1,\)"):
        trajectory(PROJECTIVE, fan, [1.0, 0.5], [0, 1, 2])
    path = trajectory(PROJECTIVE, fan, [1.0, 0.5], [0, 1, 2], invalid="nan")
    np.testing.assert_allclose(path, [[1, 0.5], [np.nan, np.nan], [-1, -0.5]], rtol=0, atol=1e-15)


@pytest.mark.parametrize("group", [TRANSLATION, PROJECTIVE], ids=str)
def test_picture_of_the_generators(group, tmp_path):
    path = tmp_path / "trajectories.png"
    figure = draw_trajectories(group, path=path)
    titles = [ax.get_title() for ax in figure.axes if ax.axison]
    assert len(titles) == group.dimension
    assert titles[0] == r"$\mathcal{L}_{x}$ u, τ = 0.2"
    assert path.stat().st_size > 10_000
    bottom, top = figure.axes[0].get_ylim()
    assert bottom > top  # y points down


def test_picture_of_a_spiral(tmp_path):
    figure = draw_trajectories(SIMILARITY, [0, 0, 0.5, -1])
    assert [ax.get_title() for ax in figure.axes] == [r"$0.5\,\mathcal{L}_{s}-1\,\mathcal{L}_{r}$, τ = 0.3"]
    with pytest.raises(InputError, match=r"rows of 4 finite numbers, not all zero"):
        draw_trajectories(SIMILARITY, np.zeros(4))
    with pytest.raises(InputError, match=r"end it in \.png"):
        draw_trajectories(TRANSLATION, [1, 0], path=tmp_path / "a.unknown")
    with pytest.raises(FieldFileError, match="cannot be saved"):
        draw_trajectories(TRANSLATION, [1, 0], path=tmp_path / "none" / "a.png")


def test_groups_are_light():
    code = "import sys, sixflow.groups, sixflow.invariants; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], check=True, capture_output=True, text=True
    )
    assert not {"matplotlib", "numba", "xarray", "scipy"} & set(done.stdout.split())


class TestRefusals:
    def test_names(self):
        assert groups.get("affine") is AFFINE
        assert groups.get(PROJECTIVE) is PROJECTIVE
        with pytest.raises(
            InputError, match="group='conformal': must be one of translation, euclidean, similarity"
        ):
            groups.get("conformal")
        with pytest.raises(InputError, match="group=3: must be one of"):
            groups.get(3)  # type: ignore[arg-type]
        for function in (trajectory, draw_trajectories):
            with pytest.raises(InputError, match="group='affine': must be a group, such as"):
                function("affine", np.zeros(6), [0.0, 0.0], [0.0]) if function is trajectory else function(
                    "affine"
                )

    def test_coefficients(self):
        with pytest.raises(
            InputError, match=r"coefficients of shape \(4,\): .* must be 3, the coefficients of L_x, L_y"
        ):
            EUCLIDEAN.exp(np.zeros(4))
        with pytest.raises(InputError, match="coefficients of dtype complex128"):
            EUCLIDEAN.exp([1j, 0, 0])
        with pytest.raises(InputError, match=r"first of shape \(\)"):
            EUCLIDEAN.bracket(1.0, [0, 0, 1])
        with pytest.raises(InputError, match=r"parameters of shape \(\)"):
            trajectory(EUCLIDEAN, [0, 0, 1], [0, 0], 1.0)
        with pytest.raises(InputError, match=r"leading shapes coefficients \(2,\), points \(3,\)"):
            EUCLIDEAN.field(np.zeros((2, 3)), np.zeros((3, 2)))
        with pytest.raises(InputError, match=r"eight of shape \(6,\): the last dimension must be 8"):
            groups.coefficients_from_eight(np.zeros(6))

    def test_matrices_of_another_algebra(self):
        many = np.stack([EUCLIDEAN.algebra([1, 2, 3]), AFFINE.algebra([0, 0, 1, 0, 0, 2])])
        with pytest.raises(
            InputError, match=r"algebra at index \(1,\) needs L_s, L_B too: the euclidean group has L_x"
        ):
            EUCLIDEAN.coefficients(many)
        with pytest.raises(InputError, match="needs L_E too"):
            AFFINE.coefficients(PROJECTIVE.algebra(np.eye(8)[6] * 1e-6))

    @pytest.mark.parametrize(
        ("group", "matrix", "reason"),
        [
            (TRANSLATION, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "maps turn nothing"),
            (TRANSLATION, [[2, 0, 0], [0, 2, 0], [0, 0, 1]], "keep all areas"),
            (EUCLIDEAN, [[2, 0, 0], [0, 2, 0], [0, 0, 1]], "keep all areas"),
            (EUCLIDEAN, [[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "neither fold nor flatten"),
            (SIMILARITY, [[2, 0, 0], [0, 1, 0], [0, 0, 1]], "keep all angles"),
            (AFFINE, [[1, 0, 0], [0, 1, 0], [0.1, 0, 1]], "last row"),
            (AFFINE, [[2, 0, 0], [0, 2, 0], [0, 0, 2]], "last row"),
            (AFFINE, [[1, 2, 0], [2, 4, 0], [0, 0, 1]], "neither fold nor flatten"),
            (PROJECTIVE, [[1, 2, 0], [2, 4, 0], [0, 0, 1]], "not singular"),
            (PROJECTIVE, np.zeros((3, 3)), "not singular"),
        ],
    )
    def test_matrices_that_are_not_in_the_group(self, group, matrix, reason):
        many = np.tile(np.eye(3), (2, 3, 1, 1))
        many[1, 2] = matrix
        inside = group.contains(many)
        assert not inside[1, 2]
        assert inside.sum() == 5
        said = rf"matrix at index \(1, 2\)=\[\[.*not in the {group.name} group, whose .*{reason}"
        for method in (group.log, group.inverse, group.adjoint, lambda M: group.act(M, [0.0, 0.0])):
            with pytest.raises(InputError, match=said):
                method(many)
        with pytest.raises(InputError, match="second at index"):
            group.compose(many, np.eye(3))
        assert np.isnan(group.log(many, invalid="nan")[1, 2]).all()

    def test_arguments_of_maps(self):
        with pytest.raises(InputError, match=r"matrix of shape \(2, 2\)"):
            AFFINE.log(np.eye(2))
        with pytest.raises(InputError, match=r"points of shape \(3,\)"):
            AFFINE.act(np.eye(3), [1, 2, 3])
        with pytest.raises(InputError, match=r"tolerance=0: must be above 0"):
            AFFINE.contains(np.eye(3), tolerance=0)
        with pytest.raises(InputError, match="taken to infinity by the map"):
            PROJECTIVE.act([[1, 0, 0], [0, 1, 0], [-0.5, 0, 1]], [2.0, 0.0])
        with pytest.raises(InputError, match="invalid='drop'"):
            PROJECTIVE.act(np.eye(3), [2.0, 0.0], invalid="drop")  # type: ignore[arg-type]

    def test_tolerance(self):
        almost = np.diag([1 + 1e-7, 1, 1])
        assert not EUCLIDEAN.contains(almost)
        assert EUCLIDEAN.contains(almost, tolerance=1e-6)
