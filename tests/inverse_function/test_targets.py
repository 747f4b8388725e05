"""Targets as arrays, leaves one by one, missing ones, and the way back from joints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from cell_functions import CELLS, f_in_numpy, function_of, middle, panda
from scipy.spatial.transform import Rotation

import repctl_pin as rp


@pytest.fixture(scope="module")
def function() -> rp.InverseFunction:
    return function_of("poses")


def forms(function: rp.InverseFunction, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates U (K, k), matrices (K, 4, 4), and positions with quaternions (K, 7)."""
    U = 0.9 * function.cell.sample(count, seed=2)
    X = np.array([function.cell.at(u).homogeneous for u in U])
    return U, X, np.c_[X[:, :3, 3], Rotation.from_matrix(X[:, :3, :3]).as_quat()]


@pytest.mark.parametrize("name", CELLS)
def test_all_forms_of_targets_are_the_same(name: str) -> None:
    function = function_of(name)
    U, X, rows = forms(function, 64)
    Q = function.batch(U)
    for targets in (X, rows, list(X), -rows * [-1, -1, -1, 1, 1, 1, 1]):
        assert np.abs(function.batch(targets) - Q).max() < 1e-9


def test_a_leaf_for_each_target_and_the_way_back(function: rp.InverseFunction) -> None:
    _, X, _ = forms(function, 64)
    C = np.random.default_rng(4).uniform(-0.1, 0.1, (64, 1))
    Q = function.batch(X, leaf=C)
    one_by_one = [function(x, leaf=c) for x, c in zip(X, C, strict=True)]
    assert np.abs(Q - one_by_one).max() < 1e-9
    back, leaves = function.pose_and_leaf(Q)
    assert np.abs(back - X).max() < 1e-9 and np.abs(leaves - C).max() < 1e-9
    assert np.abs(leaves - [function.inverse.leaf(q) for q in Q]).max() < 1e-12
    assert np.abs(function.batch(back, leaf=leaves) - Q).max() < 1e-9
    for leaf in (0.05, [0.05]):  # one number, or a list of one
        q = function(X[0], leaf=leaf)
        assert function.inverse.leaf(q) == pytest.approx(0.05, abs=1e-9)
        assert np.abs(function.batch(X[:1], leaf=leaf) - q).max() < 1e-9


def test_in_numpy_it_takes_the_same(function: rp.InverseFunction) -> None:
    slow = f_in_numpy(function)
    _, X, rows = forms(function, 64)
    C = np.random.default_rng(4).uniform(-0.1, 0.1, (64, 1))
    for leaf in (None, [0.05], C):
        assert np.abs(slow.batch(rows, leaf=leaf) - function.batch(X, leaf=leaf)).max() < 1e-9


def test_missing_targets_are_rows_of_nan(function: rp.InverseFunction) -> None:
    _, X, rows = forms(function, 6)
    Q = function.batch(X)
    rows[1, 0] += 1.0  # outside
    rows[4] = np.nan
    for one in (function, f_in_numpy(function)):
        found = one.batch(rows, missing="nan")
        assert np.isnan(found[[1, 4]]).all()
        assert np.abs(found[[0, 2, 3, 5]] - Q[[0, 2, 3, 5]]).max() < 1e-9
    far = function.batch(X, leaf=[50.0], missing="nan")  # no configuration, or beyond a limit
    assert np.isnan(far).any(axis=1).all()
    assert function.batch(rows[:0], missing="nan").shape == (0, 7)
    U = forms(function, 6)[0]
    U[1, 0], U[4] = 1.5, np.nan
    found = function.batch(U, missing="nan")
    assert np.array_equal(np.isnan(found).all(axis=1), [0, 1, 0, 0, 1, 0])
    assert np.abs(found[[0, 2, 3, 5]] - Q[[0, 2, 3, 5]]).max() < 1e-9
    X, C = function.pose_and_leaf(np.stack([function.task.reference, Q[0]]))
    assert X.shape == (2, 4, 4) and np.isnan(C[0]) and abs(C[1]) < 1e-9


def test_a_leaf_without_a_configuration_is_refused_by_number(function: rp.InverseFunction) -> None:
    """Or with one beyond a joint limit, which is the one that the chart gives."""
    U, task = forms(function, 4)[0], function.task
    x = [function.cell.at(u) for u in U]
    beyond = function.chart.solve(U[2:3], np.array([[5.0]])).Q[0]
    joint = int(np.argmin(task.limit_margin(beyond)))
    said = f"{task.joint_names[joint]} = {beyond[joint]:.4g} would be outside its limits"
    none = f"no configuration exists on this leaf at {function.cell.where(U[2])}"
    for c, words in (
        (5.0, f"no configuration at {function.cell.where(U[2])}: {said}"),
        (50.0, none),
    ):
        with pytest.raises(rp.InputError) as one:
            function(x[2], leaf=[c])
        with pytest.raises(rp.InputError) as batch:
            function.batch(x, leaf=[[0.0], [0.0], [c], [0.0]])
        assert str(one.value) == words and str(batch.value) == f"target 2: {words}"


@pytest.mark.parametrize("written", [lambda F: F, f_in_numpy], ids=["C", "NumPy"])
def test_other_leaves_keep_the_limits_where_the_first_needs_no_check(
    function: rp.InverseFunction, written: Callable[..., rp.InverseFunction]
) -> None:
    """Issue 37, item 1: F returned configurations beyond joint limits on leaves other than c = 0,
    because the evaluation of c = 0 alone had found margins. The oracle is the chart."""
    F = written(rp.InverseFunction(function.chart, keep_limits=False))
    rng, count = np.random.default_rng(37), 400
    U = 0.9 * function.cell.sample(count, seed=3)
    C = rng.uniform(-6.0, 6.0, (count, 1)) * (np.arange(count) % 4 > 0)[:, None]
    points = function.chart.solve(U, C)
    inside = function.task.limit_margin(points.Q).min(axis=1) >= 0
    wanted = points.found & (inside | (C[:, 0] == 0))
    assert 50 < (points.found & ~inside).sum() and 100 < (wanted & inside).sum()
    Q = F.batch(U, leaf=C, missing="nan")
    assert np.array_equal(np.isfinite(Q).all(axis=1), wanted)
    assert np.abs(Q - points.Q)[wanted].max() < 1e-8
    for u, c, q, good in zip(U[:80], C, Q, wanted, strict=False):
        x = function.cell.at(u)
        if good:
            assert np.abs(F(x, leaf=c) - q).max() < 1e-8
        else:
            with pytest.raises(rp.InputError, match="outside its limits|no configur"):
                F(x, leaf=c)


def test_one_row_that_is_no_rotation_is_named_among_missing_ones(
    function: rp.InverseFunction,
) -> None:
    """Also in C, where the checks are part of the kernel (issue 37, item 11)."""
    _, X, _ = forms(function, 6)
    X[1, 0, 3] += 1.0  # outside
    scaled, last = X.copy(), X.copy()
    scaled[4, :3, :3] *= 1 + 1e-5
    last[4, 3, 0] = 1e-5
    for one in (function, f_in_numpy(function)):
        for wrong, words in ((scaled, "rotation of target 4"), (last, "row of target 4")):
            with pytest.raises(rp.InputError, match=words):
                one.batch(wrong, missing="nan")
            some = one.batch(np.delete(wrong, 4, axis=0), missing="nan")
            assert np.array_equal(np.isnan(some).all(axis=1), [0, 1, 0, 0, 0])


def test_rows_that_are_not_finite_are_not_checked(function: rp.InverseFunction) -> None:
    """One number that is missing is enough, whatever the others are."""
    _, X, rows = forms(function, 4)
    Q = function.batch(X)
    rows[1], X[1] = 2 * rows[1], 2 * X[1]
    X[2] *= np.array([1, 1, -1, 1])
    rows[1, 0] = X[1, 0, 3] = X[2, 0, 3] = np.nan
    for targets, bad in ((rows, [1]), (X, [1, 2])):
        found = function.batch(targets, missing="nan")
        assert np.isnan(found[bad]).all() and np.abs(found[0] - Q[0]).max() < 1e-9


LAST = np.array([[1.0], [1.0], [1.1]])
"""Factors that change the last of three targets only."""

ROW, TURN = (np.zeros((4, 4)) for _ in range(2))
ROW[3, 0] = TURN[0, 0] = 1e-6
"""Changes of the last row of a matrix, and of its rotation."""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda X, rows: rows * [1, 1, 1, 2, 2, 2, 2], "quaternion of target 0 has length 2"),
        (lambda X, rows: rows * 1.00015, "quaternion of target 0 has length 1"),
        (lambda X, rows: X + 1.5 * ROW, "last row of target 0"),
        (lambda X, rows: X + 2 * TURN @ np.ones((4, 4)), "rotation of target 0"),
        (lambda X, rows: X * np.array([1, 1, -1, 1]), "rotation of target 0"),
        (lambda X, rows: rows[:, :5], "coordinates of this cell"),
        (lambda X, rows: rows[0, :6], r"of this cell must be numbers \(K, 6\)"),
        (lambda X, rows: X[:, :3], "matrices"),
        (lambda X, rows: X * 1.1, "last row of target 0"),
        (lambda X, rows: X * LAST[:, :, None], "last row of target 2"),
        (lambda X, rows: rows * LAST, "quaternion of target 2 has length 1.1"),
        (lambda X, rows: X * np.array([1.1, 1.1, 1.1, 1]), "rotation of target 0"),
        (lambda X, rows: X.astype(complex), "real numbers"),
        (lambda X, rows: rows * [1000, 1000, 1000, 1, 1, 1, 1], "target 0 lies outside the cell"),
    ],
)
def test_bad_arrays_are_refused_by_number(
    function: rp.InverseFunction, change: object, words: str
) -> None:
    _, X, rows = forms(function, 3)
    with pytest.raises(rp.InputError, match=words):
        function.batch(change(X, rows))  # type: ignore[operator]


def test_targets_that_are_rounded_are_taken(function: rp.InverseFunction) -> None:
    """Quaternions to 1e-4 of length 1, matrices to 1e-6."""
    _, X, rows = forms(function, 3)
    Q = function.batch(X)
    assert np.abs(function.batch(rows * [1, 1, 1, *[1.00009] * 4]) - Q).max() < 1e-9
    for change in (0.9 * ROW, 0.4 * TURN):
        assert np.abs(function.batch(X + change) - Q).max() < 1e-5


def test_bad_options_are_refused(function: rp.InverseFunction) -> None:
    _, X, _ = forms(function, 3)
    assert function.batch(X, threads=256).shape == (3, 7)
    with pytest.raises(rp.InputError, match="threads can be at most 256"):
        function.batch(X, threads=257)
    with pytest.raises(rp.InputError, match="missing"):
        function.batch(X, missing="skip")  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match=r"leaves must be finite numbers \(3, 1\)"):
        function.batch(X, leaf=np.zeros((2, 1)))
    with pytest.raises(rp.InputError, match="the leaf c must be 1 finite numbers"):
        function(X[0], leaf="low")  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="this function"):
        function.pose_and_leaf(np.zeros((2, 3)))


@pytest.mark.parametrize("name", ["Cell", "Sector"])
def test_a_cell_takes_one_row_per_pose_and_no_stacks(name: str) -> None:
    """A single row, or a stack of rows, would broadcast to something else than poses."""
    task, x = panda(), middle()
    cell = (
        rp.Cell(task, x, 0.1, 0.2)
        if name == "Cell"
        else rp.Sector(task, x, radius=0.1, height=0.1, angle=0.5, half_angle=0.2)
    )
    U = cell.sample(3)
    p, R = cell.placements(U)
    turns = np.zeros((3, 3))
    given = {
        "placements": (U,),
        "spread": (U,),
        "coordinates": (p, R),
        "inside": (U, np.zeros(3)),
        "twists": (U, R),
        "slopes": (p, R),
        "errors": (p, R, p, R),
        "vectors": (turns,),
    }
    for method, arrays in given.items():
        getattr(cell, method)(*arrays)
        for wrong in (np.stack([arrays[0]] * 2), arrays[0][0]):
            with pytest.raises(rp.InputError, match=r"must be numbers \(K, \d"):
                getattr(cell, method)(wrong, *arrays[1:])
