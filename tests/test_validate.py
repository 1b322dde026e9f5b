"""The normalised median test and what stands in for failed points."""

import numpy as np
import pytest

import naive
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.judge.chance import normal_limit
from sixflow.judge.flags import _collapses, bias_rules, isolated, judged
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import LIMIT, fill_failed, median_outliers, settle
from sixflow.prepare.frame import NO_MASK, Frame
from solved import plan_of, solution_of

STEP, WINDOW = 8, 31  # neighbours are asked 2 points away
GRID = Grid(3, 3, STEP, 12, 10)
AFFINE = GRID.plane(np.array([2.0, -1.0, 0.03, -0.05, 0.02, 0.04]))


def wavy(seed=1):
    rng = np.random.default_rng(seed)
    maps = AFFINE + 0.05 * rng.normal(size=AFFINE.shape)
    maps[2:] = AFFINE[2:] + 0.002 * rng.normal(size=(4, *GRID.shape))
    for j, i in [(0, 0), (4, 5), (5, 5), (9, 11), (7, 2)]:
        maps[:2, j, i] += rng.normal(0, 3, 2)
    maps[:, 2, 3] = np.nan
    maps[:, 6:8, 8:] = np.nan
    return maps


@pytest.mark.parametrize(
    ("step", "window", "reach"), [(8, 31, 2), (8, 8, 1), (8, 64, 4), (8, 400, 4), (31, 31, 1)]
)
@pytest.mark.parametrize("floor", [0.05, 0.3])
def test_median_test(step, window, reach, floor):
    maps = wavy()
    fast = median_outliers(maps, step, window, floor)
    slow = naive.median_outliers(maps, step, reach, np.full(GRID.shape, floor), LIMIT)
    np.testing.assert_array_equal(fast, slow)


def test_median_test_with_a_floor_for_every_point():
    floor = np.random.default_rng(2).uniform(0.01, 1, GRID.shape)
    fast = median_outliers(wavy(), STEP, WINDOW, floor)
    np.testing.assert_array_equal(fast, naive.median_outliers(wavy(), STEP, 2, floor, LIMIT))


def test_an_affine_field_has_no_outliers_and_one_that_stands_out_is_found():
    assert not median_outliers(AFFINE, STEP, WINDOW).any()
    for component in (0, 1):
        for at in ((0, 0), (0, 6), (5, 5), (9, 11)):
            maps = AFFINE.copy()
            maps[(component, *at)] += 0.5
            expected = np.zeros(GRID.shape, bool)
            expected[at] = True
            np.testing.assert_array_equal(median_outliers(maps, STEP, WINDOW), expected)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2), (3, 3)])
def test_small_grids(shape):
    maps = np.zeros((6, *shape))
    assert not median_outliers(maps, STEP, WINDOW).any()
    np.testing.assert_array_equal(settle(maps, STEP, WINDOW), maps)


def test_nothing_to_fill():
    assert fill_failed(AFFINE, STEP) is AFFINE


def test_nothing_known():
    np.testing.assert_array_equal(fill_failed(np.full_like(AFFINE, np.nan), STEP), 0)


def test_a_gap_is_filled_from_its_neighbours_maps():
    maps = AFFINE.copy()
    gaps = [(0, 0), (4, 5), (9, 6)]
    for at in gaps:
        maps[(slice(None), *at)] = np.nan
    before = maps.copy()
    filled = fill_failed(maps, STEP)
    np.testing.assert_array_equal(maps, before)
    np.testing.assert_allclose(filled[:2], AFFINE[:2], atol=1e-12)
    known = ~np.isnan(maps[0])
    np.testing.assert_array_equal(filled[:, known], AFFINE[:, known])
    np.testing.assert_allclose(filled[2:], AFFINE[2:])


def test_what_is_special_in_a_guessed_gradient_is_held_back():
    maps = AFFINE.copy()
    maps[2, :3, :3] += 0.5
    maps[:, 0, 0] = np.nan
    filled = fill_failed(maps, STEP)
    np.testing.assert_allclose(filled[2, 0, 0], AFFINE[2, 0, 0] + 0.8 * 0.5)
    np.testing.assert_allclose(filled[3:, 0, 0], AFFINE[3:, 0, 0])


def test_one_known_point_fills_everything():
    maps = np.full_like(AFFINE, np.nan)
    maps[:, 3, 4] = [1, 2, 0, 0, 0, 0]
    filled = fill_failed(maps, STEP)
    np.testing.assert_allclose(filled[0], 1)
    np.testing.assert_allclose(filled[1], 2)


def test_partly_failed_points_count_as_failed():
    maps = AFFINE.copy()
    maps[3, 4, 4] = np.nan
    assert np.isfinite(fill_failed(maps, STEP)).all()


def test_settle_replaces_outliers():
    maps = AFFINE.copy()
    maps[:2, 4, 5] += 9
    settled = settle(maps, STEP, WINDOW)
    np.testing.assert_allclose(settled[:2], AFFINE[:2], atol=1e-12)


def judge(maps=None, valid=NO_MASK, **changes):
    frame = Frame(50 * np.random.default_rng(3).normal(size=(80, 96)), valid)
    maps = GRID.plane(np.zeros(6)) if maps is None else maps
    return judged(solution_of(maps, **changes), GRID, frame, plan_of((80, 96))).flag


def one_point(value, ordinary):
    values = np.full(GRID.shape, ordinary)
    values[4, 5] = value
    return values


@pytest.mark.parametrize(
    ("changes", "flags"),
    [
        ({}, []),
        ({"texture": one_point(0.2, 50.0)}, ["low_texture"]),
        ({"texture": one_point(np.nan, 50.0)}, ["low_texture"]),
        ({"weight": one_point(0.9, 1.0)}, ["border"]),
        ({"weight": one_point(0.1, 1.0)}, ["border", "unmatched"]),
        ({"correlation": one_point(0.2, 0.995)}, ["unmatched"]),
        ({"correlation": one_point(0.2, 0.995), "texture": one_point(0.0, 50.0)}, ["unmatched"]),
    ],
)
def test_flags(changes, flags):
    expected = np.zeros(GRID.shape, np.uint16)
    expected[4, 5] = sum(FLAGS[name] for name in flags)
    np.testing.assert_array_equal(judge(**changes), expected)


def test_large_or_unknown_errors_are_low_texture():
    for value in (1.0, np.nan):
        covariance = np.broadcast_to(1e-4 * np.eye(6), (*GRID.shape, 6, 6)).copy()
        covariance[4, 5] *= value * 1e5 if value == 1.0 else np.nan
        assert judge(covariance=covariance)[4, 5] == FLAGS["low_texture"]


def test_singular_points_are_low_texture():
    maps = GRID.plane(np.zeros(6))
    maps[:, 4, 5] = np.nan
    assert judge(maps)[4, 5] == FLAGS["low_texture"]


def test_points_that_leave_the_frame_are_unmatched():
    flag = judge(GRID.plane(np.array([30.0, 0, 0, 0, 0, 0])))
    gone = np.broadcast_to(GRID.x + 30 > 95, GRID.shape)
    assert (flag[gone] & FLAGS["unmatched"]).all()
    assert not (flag[~gone] & FLAGS["unmatched"]).any()


def test_unsettled_points_are_not_converged():
    flag = judge(left=one_point(1.0, 0.0))
    assert flag[4, 5] & FLAGS["not_converged"]
    assert np.count_nonzero(flag) == 1


def test_outliers_are_flagged():
    maps = GRID.plane(np.zeros(6))
    maps[0, 4, 5] = 2
    flag = judge(maps)
    assert flag[4, 5] == FLAGS["outlier"]
    assert np.count_nonzero(flag) == 1


def test_masked_hides_everything_else():
    valid = np.ones((80, 96), np.uint8)
    valid[:40] = 0
    maps = GRID.plane(np.zeros(6))
    maps[:, 0, 0] = np.nan
    flag = judge(maps, valid, texture=np.zeros(GRID.shape))
    masked = np.broadcast_to((GRID.y < 40)[:, None], GRID.shape)
    np.testing.assert_array_equal(flag[masked], FLAGS["masked"])
    assert not (flag[~masked] & FLAGS["masked"]).any()


def test_border_alone_does_not_fail():
    standing = FLAGS["border"] | FLAGS["unresolved"] | FLAGS["replaced"]
    assert sum(FLAGS.values()) == FAILING | standing
    assert not FAILING & standing


def test_points_without_support_take_those_with_them_that_stand_on_them():
    failed = np.ones((12, 12), bool)
    failed[7:, 7:] = False
    for place in ((2, 2), (2, 3), (3, 3), (3, 4)):  # the outer two first, then the inner two
        failed[place] = False
    alone = isolated(np.where(failed, FLAGS["unmatched"], 0).astype(np.uint16))
    assert alone[2:4, 2:5].sum() == 4
    assert not alone[7:, 7:].any()
    # what nobody asked for has not failed
    assert not isolated(np.where(failed, FLAGS["masked"], 0).astype(np.uint16)).any()


def test_maps_that_fold_the_window_are_outliers():
    maps = np.zeros((6, 2, 2))
    maps[2:, 0, 0] = -1.13, 0.17, -0.29, -0.4  # det F = -0.03
    maps[2:, 0, 1] = -0.7, 0.0, 0.0, -0.7  # 0.09
    maps[2:, 1, 0] = -2.0, 0.0, 0.0, -2.0  # half a turn
    np.testing.assert_array_equal(_collapses(maps, "first"), [[True, False], [False, False]])
    maps[2:, 0, 0] = 2.1, 0.0, 0.0, 0.0  # seen from the middle, frame 0 is folded
    assert _collapses(maps, "middle")[0, 0]
    assert not _collapses(maps, "first")[0, 0]


def test_bias_rules_where_it_stands_out_of_noise():
    bias = np.zeros((*GRID.shape, 6))
    bias[2, 3, 1] = bias[4, 5, 2] = 1.1e-4 * normal_limit() ** 2  # of v, and of a gradient
    bias[6, 7, 0] = 0.9e-4 * normal_limit() ** 2  # the noise's variance is 1e-4
    found = solution_of(GRID.plane(np.zeros(6)))
    assert not bias_rules(found).any()
    assert np.argwhere(bias_rules(found.replace(bias=bias))).tolist() == [[2, 3]]
