"""One function for a cell: the sections' laws, the optimum, and the function that comes out."""

from __future__ import annotations

import json
import pickle
import re
import warnings
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA, planar_task, planar_urdf, sliding_task, spatial_task
from cell_functions import cell_of, chart_of, middle, panda, tour
from controls import in_numpy, some
from design_file import checksum

import repctl_pin as rp


@cache
def found(rotation: float = 0.0) -> rp.CellDesign:
    cell = cell_of(rotation=rotation)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    return rp.nearest_inverse_function(
        rp.Pseudoinverse(cell.task),
        cell,
        posture=q,
        degree=2,
        options=rp.FitOptions(samples=128, held_out=256),
    )


def designed(
    cell: rp.Cell, posture: Any, *, degree: int = 1, samples: int = 32, **options: Any
) -> rp.CellDesign:
    """A small design near J⁺, for what does not depend on its quality."""
    return rp.nearest_inverse_function(
        rp.Pseudoinverse(cell.task),
        cell,
        posture=posture,
        degree=degree,
        options=rp.FitOptions(samples=samples, held_out=64),
        **options,
    )


# ---- cells ---------------------------------------------------------------------------------------


def test_turns_of_a_cell_agree_with_pinocchio() -> None:
    """Placements, coordinates and their velocities at turns of all sizes, and none at all."""
    cell, rng = cell_of(rotation=1.0), np.random.default_rng(0)
    U = rng.uniform(-1, 1, (20, 6))
    U[:, 3:] *= np.logspace(-9, 0, 20)[:, None]
    U[0, 3:] = 0.0
    U[12, 3:] *= 9e-5 / np.linalg.norm(U[12, 3:])
    p, R = cell.placements(U)
    back, off = cell.coordinates(p, R)
    assert np.allclose(back, U, rtol=0, atol=1e-14) and np.allclose(off, 0)
    for u, here, E in zip(U, R, cell.twists(U, R), strict=True):
        turn = pin.exp3(u[3:])
        assert np.allclose(here, turn @ cell.placement.rotation, rtol=0, atol=1e-14)
        assert np.allclose(pin.log3(turn), u[3:], rtol=0, atol=1e-14)
        left = pin.Jexp3(u[3:]).T  # the transpose of Pinocchio's, which is the right one
        assert np.allclose(E[3:, 3:], left, rtol=0, atol=1e-12)
    assert cell.placements(np.empty((0, 6)))[1].shape == (0, 3, 3)
    R = R.copy()
    R[3, 0, 1] = np.nan  # the other rows do not change
    without, _ = cell.coordinates(p, R)
    assert np.isnan(without[3, 3:]).all()
    assert np.allclose(np.delete(without - U, 3, axis=0), 0, rtol=0, atol=1e-14)


def test_errors_of_a_tool_axis_are_those_of_the_task() -> None:
    """Of rotations anywhere, and of axes that are the same but for rounding."""
    task, cell = panda("axis"), cell_of("axis", 0.3)
    Q = np.random.default_rng(0).uniform(-1, 1, (20, 7))
    here = [task.placement(q) for q in Q]
    goals = [*here[::-1][:-1], here[-1]]
    p, R = (np.array([getattr(x, a) for x in here]) for a in ("translation", "rotation"))
    p_to, R_to = (np.array([getattr(x, a) for x in goals]) for a in ("translation", "rotation"))
    due = [task.error(q, x) for q, x in zip(Q, goals, strict=True)]
    assert np.allclose(cell.errors(p_to, R_to, p, R), due, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "rotation"),
    [
        ("pose", 0.3),
        ("pose", (0.2, 0.0, 0.4)),
        ("pose", 0),
        ("axis", 0.3),
        ("position", 0),
        ("xy", 0),
    ],
)
def test_coordinates_placements_and_their_velocities(kind: str, rotation: object) -> None:
    task = panda(kind)
    cell = rp.Cell(task, middle(kind), 0.1, rotation)
    U = cell.sample(8)
    p, R = cell.placements(U)
    back, off = cell.coordinates(p, R)
    assert np.allclose(back, U) and np.allclose(off, 0)
    assert np.allclose([cell.coordinates_of(cell.at(u)) for u in U], U)
    E, h = cell.twists(U, R), 1e-6
    for k in range(cell.k):  # E is the velocity of the placement: errors to one a little further
        step = h * np.eye(cell.k)[k]
        assert np.allclose(cell.errors(*cell.placements(U + step), p, R) / h, E[:, :, k], atol=1e-5)
    # a task's error in coordinates: u(f(q)) changes by ∂u/∂x J
    Q = np.array([rp.solve_ik(task, Q_PANDA, cell.at(u)) for u in U[:3]])
    placements = [task.placement(q) for q in Q]
    p, R = (
        np.array([getattr(x, name) for x in placements]) for name in ("translation", "rotation")
    )
    _, dU = cell.slopes(p, R)
    for q, slope in zip(Q, dU @ task.jacobians(Q), strict=True):
        d = 1e-6 * np.random.default_rng(1).normal(size=task.n)
        ends = [task.placement(q + s * d) for s in (1, -1)]
        up, down = (cell.coordinates(x.translation[None], x.rotation[None])[0][0] for x in ends)
        assert np.allclose((up - down) / 2, slope @ d, atol=1e-11)


def test_a_cell_goes_round_poses_and_paths() -> None:
    task, cell = panda(), cell_of(rotation=0.3)
    poses = [cell.at(u) for u in cell.sample(16)]
    around = rp.Cell.around(task, poses, margin=0.01)
    U, off = around.coordinates(
        *(np.array([getattr(x, a) for x in poses]) for a in ("translation", "rotation"))
    )
    assert (np.abs(U) <= 1).all() and np.allclose(off, 0) and np.abs(U).max() > 0.8
    path = rp.circle(task, Q_PANDA, 0.1, normal="x")
    assert np.allclose(
        rp.Cell.around(task, path, margin=0.01).half_width, [0.01, 0.11, 0.11], atol=1e-3
    )


@pytest.mark.parametrize(
    ("kind", "half_width", "half_angle"),
    [
        ("pose", [0.11, 0.02, 0.08], [0.25, 0, 0.1]),
        ("axis", [0.11, 0.02, 0.08], [0.25, 0]),
        ("position", [0.11, 0.02, 0.08], []),
        ("xy", [0.11, 0.02], []),
    ],
)
def test_a_cell_around_two_poses_is_centred_between_them(
    kind: str, half_width: list, half_angle: list
) -> None:
    """They are 0.2 m and 0.4 rad apart, about the base's x axis, or the tool's of an axis task."""
    task, x = panda(kind), middle(kind)
    more = {"margin": half_width - np.array([0.1, 0, 0.05])[: len(half_width)]}
    if half_angle:
        more["half_angle"] = np.array(half_angle) - [0.2, 0, 0][: len(half_angle)]

    def turned(angle: float) -> np.ndarray:
        turn = pin.exp3(np.array([angle, 0, 0]))
        return x.rotation @ turn if kind == "axis" else turn @ x.rotation

    ends = [
        pin.SE3(turned(angle), x.translation + step * np.array([0.1, 0, -0.05]))
        for angle, step in ((0.1, 1), (0.5, -1))
    ]
    cell = rp.Cell.around(task, ends, **more)
    assert np.allclose(cell.half_width, half_width, atol=1e-12)
    assert np.allclose(cell.rotation, half_angle, atol=1e-9)
    assert np.allclose(cell.placement.translation, x.translation, atol=1e-12)
    plain, one = rp.Cell.around(task, ends[::-1]), rp.Cell.around(task, ends[:1], 0.1)
    for around in (cell, plain) if half_angle else ():
        assert np.allclose(around.placement.rotation, turned(0.3), atol=1e-12)
    reach = np.array([0.1, 0, 0.05])[: len(half_width)]
    assert np.allclose(plain.half_width, reach + 0.02, atol=1e-12)
    assert np.allclose(plain.rotation, [0.2, 0, 0][: len(half_angle)], atol=1e-9)
    assert (one.half_width == 0.1).all() and not one.rotation.any()
    assert np.allclose(one.placement.homogeneous, ends[0].homogeneous)


def test_poses_that_no_cell_can_enclose() -> None:
    with pytest.raises(rp.InputError, match="task must be"):
        rp.Cell.around(3, [middle()])  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="not an empty list"):
        rp.Cell.around(panda(), [])
    with pytest.raises(rp.InputError, match="leaves the rotation free"):
        rp.Cell.around(panda("position"), [middle()], 0.1, half_angle=0.1)


def test_sampled_poses_fill_a_cell_evenly() -> None:
    """Half of any number of Sobol points that is a power of 2 is on either side of the middle, and
    a quarter in either half of a side."""
    cell = cell_of(rotation=0.2)
    U = cell.sample(64, 3)
    for bound in (-0.5, 0.0, 0.5):
        assert ((U < bound).sum(axis=0) == 32 + 32 * bound).all()
    for count in (1, 2, 100):
        assert (np.abs(cell.sample(count)) <= 1).all()
        assert cell.sample(count).shape == (count, 6)
    assert (cell.sample(8) == cell.sample(8, 0)).all()
    assert (cell.sample(8) != cell.sample(8, 1)).any()


def test_arrays_of_a_cell_are_lists_of_poses_of_which_some_may_be_missing() -> None:
    """One axis more is refused. NaN in one pose is NaN there, and changes nothing elsewhere."""
    cell = cell_of(rotation=0.3)
    U = cell.sample(4)
    p, R = cell.placements(U)
    calls = {
        cell.placements: (U,),
        cell.coordinates: (p, R),
        cell.inside: (U, np.zeros(4)),
        cell.twists: (U, R),
        cell.slopes: (p, R),
        cell.errors: (p, R, p, R),
        cell.spread: (U,),
        cell.vectors: (U[:, 3:],),
    }
    for method, arrays in calls.items():
        with pytest.raises(rp.InputError, match=r"must be numbers \(K"):
            method(*(a[None] for a in arrays))
        holes = [a.copy() for a in arrays]
        for a in holes:
            a[2] = np.nan
        if method == cell.inside:
            with pytest.raises(rp.InputError, match="target 2 has a number that is not finite"):
                method(*holes)
            continue
        results = [method(*given) for given in (arrays, holes)]
        due, found = (r if isinstance(r, tuple) else (r,) for r in results)
        others = np.arange(4) != 2
        assert all(np.allclose(x[others], y[others]) for x, y in zip(due, found, strict=True))
        assert not np.isfinite(found[0][2]).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"half_width": -0.1}, "half_width must be 0 m or more"),
        ({"half_width": (0.1, -0.1, 0.1)}, "half_width must be 0 m or more"),
        ({"half_width": (0.1, np.inf, 0.1)}, "half_width must be 0 m or more"),
        ({"half_width": (0.1, np.nan, 0.1)}, "half_width must be 0 m or more"),
        ({"half_angle": (0, 0, 3.0)}, "half_angle has the norm 3 rad"),
        ({"placement": [0.3, np.nan, 0.2]}, "placement must be finite numbers"),
        ({"half_width": (0.1, 0.2)}, "half_width must be one number"),
        ({"half_width": 0.0}, "above 0"),
        (
            {"half_width": 1e-300},
            "half_width must be 0, which holds the coordinate constant, or from 1e-06 to 1000 m; "
            "got 1e-300",
        ),
        ({"half_width": (0.1, 1e300, 0.1)}, "from 1e-06 to 1000 m"),
        ({"half_angle": 1e-12}, "half_angle must be 0"),
        ({"half_angle": 2.0}, "half a turn"),
        ({"placement": "home"}, "placement"),
        ({"task": 3}, "task must be"),
    ],
)
def test_cells_that_make_no_sense(change: dict, says: str) -> None:
    options = {"task": panda(), "placement": middle(), "half_width": 0.1} | change
    with pytest.raises(rp.InputError, match=says):
        rp.Cell(**options)
    with pytest.raises(rp.InputError, match="leaves the rotation free"):
        rp.Cell(panda("position"), middle(), 0.1, 0.2)
    for half_width in (1e-6, 1000.0):  # the smallest and the largest that the message names
        assert (rp.Cell(panda(), middle(), half_width).half_width == half_width).all()


def test_a_cell_says_its_size_and_where_a_pose_is() -> None:
    def cell(kind: str, *widths) -> rp.Cell:
        return rp.Cell(panda(kind), middle(kind), *widths)

    u, wide = np.array([1.0, 0.0, -1.0, 1.0, 0.5]), (0.1, 0.15, 0.1)
    turned = cell("pose", wide, (0.2, 0, 0.4))
    assert turned.size() == "±(0.1, 0.15, 0.1) m, turned by ±(0.2, 0, 0.4) rad"
    place = "({:.3g}, {:.3g}, {:.3g}) m".format(
        *np.round(middle().translation + 0.1 * u[:3], 9) + 0.0
    )
    by = ", turned by (0.2, 0, 0.2) rad from the middle's orientation"
    assert turned.where(u) == place + by and turned.where(u * (1, 1, 1, 0, 0)) == place
    assert turned.names == ("x", "y", "z", "about x", "about z")
    assert turned.units == ("m", "m", "m", "rad", "rad")
    assert cell("axis", wide, 0.3).size() == "±(0.1, 0.15, 0.1) m, turned by ±0.3 rad"
    assert cell("axis", wide).size() == "±(0.1, 0.15, 0.1) m, one orientation"
    assert cell("position", wide).size() == "±(0.1, 0.15, 0.1) m"
    assert cell("axis", 0.1, (0, 0.3)).names == ("x", "y", "z", "about tool y")
    text = f"<Cell ±(0.1, 0.15, 0.1) m around {place}, panda_hand_tcp position>"
    at = pin.SE3(np.eye(3), middle().translation + 0.1 * u[:3])
    assert repr(rp.Cell(panda("position"), at, wide)) == text
    near = rp.Cell(panda("position"), [0.4, -4e-10, 4e-10], wide)  # to the nanometre
    assert near.where(np.zeros(3)) == "(0.4, 0, 0) m"
    at_rest = panda().placement(panda().reference).rotation
    assert np.allclose(near.placement.rotation, at_rest)


# ---- sections ------------------------------------------------------------------------------------


def test_monomials_differentiate() -> None:
    cell = cell_of()
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    monomials = chart_of(cell, q, degree=4).monomials
    U = np.random.default_rng(0).uniform(-1, 1, (5, 3))
    T = monomials.values(U)
    assert monomials.size == 35 and np.allclose(
        T, np.prod(U[:, None] ** monomials.exponents, axis=2)
    )
    for j in range(3):
        d = 1e-6 * np.eye(3)[j]
        slope = (monomials.values(U + d) - monomials.values(U - d)) / 2e-6
        assert np.allclose(monomials.slopes(T)[:, :, j], slope, atol=1e-8)
    C = np.random.default_rng(1).normal(size=(35, 2))
    lower, D = monomials.differentiated(C)
    due = np.einsum("KNk,Nr->Krk", monomials.slopes(T), C)
    assert lower.degree == 3 and np.allclose(np.einsum("KN,Nrk->Krk", lower.values(U), D), due)
    assert np.allclose(monomials.fit(np.random.default_rng(2).uniform(-1, 1, (99, 3)),
                                     np.ones((99, 2)))[0], 1)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "rotation"), [("pose", 0.2), ("axis", 0.2), ("position", 0.0), ("xy", 0.0)]
)
def test_a_section_is_exact_and_its_derivative_is_its_derivative(
    kind: str, rotation: float
) -> None:
    cell = cell_of(kind, rotation, 0.08)
    chart = chart_of(cell, rp.solve_ik(cell.task, Q_PANDA, cell.placement), degree=2)
    U, r = 0.9 * cell.sample(6, 3), cell.task.r
    terms = chart.monomials
    a = 0.05 * np.random.default_rng(0).normal(size=(terms.size, r))

    def section(U: np.ndarray) -> np.ndarray:
        points = chart.solve(U, terms.values(U) @ a)
        assert points.found.all()
        return points.Q

    points = chart.solve(U, terms.values(U) @ a)
    for q, u in zip(points.Q, U, strict=True):
        assert np.abs(cell.task.error(q, cell.at(u))).max() < 1e-9
    q_ref, n_ref = chart.reference(U)
    assert np.allclose(np.einsum("Knr,Kn->Kr", n_ref, points.Q - q_ref), terms.values(U) @ a)
    dF, B = chart.derivative(points, np.einsum("KNk,Nr->Krk", terms.slopes(terms.values(U)), a))
    for j in range(cell.k):
        d = 1e-5 * np.eye(cell.k)[j]
        assert np.allclose((section(U + d) - section(U - d)) / 2e-5, dF[:, :, j], atol=1e-7)
    for j in range(r):
        d = 1e-5 * np.eye(r)[j]
        up, down = (chart.solve(U, terms.values(U) @ a + w * d).Q for w in (1, -1))
        assert np.allclose((up - down) / 2e-5, B[:, :, j], atol=1e-7)


# ---- the function
# ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("rotation", some([0.0, 0.25], 0.25))
def test_the_function_is_exact_and_without_history(rotation: float) -> None:
    design = found(rotation)
    F, cell, task = design.function, design.cell, design.task
    U = cell.sample(64, 9)
    targets = [cell.at(u) for u in U]
    Q = F.batch(targets)
    assert max(np.abs(task.error(q, x)).max() for q, x in zip(Q, targets, strict=True)) < 1e-9
    order = np.random.default_rng(0).permutation(len(U))
    for i in order:
        assert np.abs(F(targets[i]) - Q[i]).max() < 1e-9
    inverse, q = design.inverse, Q[0]
    for i in order:  # the same joints by the control, step after step, whatever the way
        q = inverse.solve(targets[i], q, leaf=np.zeros(1))
        assert np.abs(q - Q[i]).max() < 1e-9
    assert np.allclose(F.batch(U), Q) and np.allclose([inverse.leaf(q) for q in Q], 0, atol=1e-9)


@pytest.mark.parametrize("kind", ["pose", "axis", "position"])
def test_the_field_is_the_section_and_its_gradient(kind: str) -> None:
    cell = cell_of(kind, 0.2 if kind != "position" else 0.0, 0.08)
    task = cell.task
    F = rp.InverseFunction(
        chart_of(cell, rp.solve_ik(task, Q_PANDA, cell.placement), degree=2, count=64)
    )
    potentials = F.inverse.potentials
    rng = np.random.default_rng(0)
    Q = F.batch(0.7 * cell.sample(4)) + 0.02 * rng.normal(size=(4, task.n))
    for q, V in zip(Q, potentials.gradients(Q), strict=True):
        for _ in range(2):
            d = rng.normal(size=task.n)
            slope = (potentials.value(q + 1e-6 * d) - potentials.value(q - 1e-6 * d)) / 2e-6
            assert np.allclose(V.T @ d, slope, atol=1e-7)
    u = 0.5 * np.ones(cell.k)
    G = F.jacobian(cell.at(u))
    assert np.allclose(task.jacobian(F(cell.at(u))) @ G, np.eye(task.m), atol=1e-9)
    E = cell.twists(u[None], task.placement(F(cell.at(u))).rotation[None])[0]
    for j in range(cell.k):
        d = 1e-6 * np.eye(cell.k)[j]
        slope = (F(cell.at(u + d)) - F(cell.at(u - d))) / 2e-6
        assert np.allclose(G @ E[:, j], slope, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "rotation"),
    [
        ("pose", 0.3),
        ("pose", 0),
        ("pose", (0.2, 0.0, 0.4)),
        ("axis", 0.3),
        ("axis", (0.2, 0)),
        ("position", 0),
        ("xy", 0),
    ],
)
def test_potentials_in_c_are_the_potentials(kind: str, rotation: object) -> None:
    """On random polynomials, inside the cell and off what it holds: C, and finite
    differences."""
    cell = rp.Cell(panda(kind), middle(kind), 0.3, rotation)
    task, rng = cell.task, np.random.default_rng(0)
    q = rp.solve_ik(task, Q_PANDA, cell.placement)
    chart = chart_of(rp.Cell(task, middle(kind), 0.01, rotation), q)
    random = rng.normal(size=chart.coefficients.shape)
    F = rp.InverseFunction(replace(chart, cell=cell, coefficients=random))
    potentials = F.inverse.potentials
    for _ in range(3):
        q, d = Q_PANDA + 0.1 * rng.normal(size=task.n), rng.normal(size=task.n)
        h, V, G = potentials.value(q), potentials.gradient(q), F.inverse(q)
        assert np.allclose(F.inverse.leaf(q), h, rtol=0, atol=1e-12 * np.abs(h).max())
        away = np.abs(F.inverse.batch(q[None])[0] - G).max()
        assert away < 1e-10 * np.abs(G).max()
        slope = (potentials.value(q + 1e-6 * d) - potentials.value(q - 1e-6 * d)) / 2e-6
        assert np.allclose(d @ V, slope, rtol=0, atol=1e-6 * np.abs(V).max())


@pytest.mark.slow
def test_ten_laps_of_a_random_tour_through_all_turns() -> None:
    design = found(0.25)
    path = tour(design.cell, 1, reach=0.999)
    U = np.array([design.cell.coordinates_of(path.placement(s)) for s in np.linspace(0, 1, 200)])
    assert (np.abs(U).max(axis=0) > 0.99).all()  # through all of the cell
    q0 = design.function(path.placement(0.0))
    kept = rp.follow(design.inverse, path, q0, cycles=10, steps=100, integrator=rp.LeafLock(3))
    crept = rp.follow(design.desired, path, q0, cycles=10, steps=100)
    assert kept.drift.max() < 1e-9 < 1e-2 < crept.drift[-1]
    Q = design.function.batch(U)
    again = design.function.batch([path.placement(s) for s in np.linspace(0, 1, 200)])
    assert np.abs(Q - again).max() < 1e-9


def test_a_closed_tour_closes_and_a_pushed_arm_comes_back() -> None:
    design = found()
    path = rp.circle(
        design.task, design.function(design.cell.at(np.array([0.8, 0.0, 0.0]))), 0.08, normal="z"
    )
    q0 = design.function(path.placement(0.0))
    motion = rp.follow(design.inverse, path, q0, cycles=2, steps=40, integrator=rp.LeafLock(3))
    assert motion.drift.max() < 1e-9
    for i in range(0, 41, 8):
        assert np.abs(motion.q[i] - design.function(path.placement(i / 40))).max() < 1e-8
    pushed = rp.follow(
        design.inverse,
        path,
        q0 + 0.05,
        cycles=2,
        steps=40,
        integrator=rp.LeafLock(3, leaf=np.zeros(1)),
    )
    assert np.abs(pushed.q[-1] - q0).max() < 1e-9


def test_leaves_are_an_interval_inside_the_limits() -> None:
    design = found()
    F, x = design.function, design.cell.at(np.array([0.3, -0.4, 0.2]))
    low, high = F.leaves(x)[0]
    assert low < -0.1 and high > 0.1
    for c in (0.999 * low, 0.5 * high, 0.999 * high):
        q = F(x, leaf=[c])
        assert np.abs(design.task.error(q, x)).max() < 1e-9
        assert design.inverse.leaf(q)[0] == pytest.approx(c)
        design.task.check(q)


@pytest.mark.parametrize(
    ("limits", "ends"),
    [
        ((-0.5, 7.0), (-0.9, np.pi)),
        pytest.param((-7.0, 0.9), (-np.pi, 0.5), marks=pytest.mark.slow),
    ],
)
def test_leaves_end_at_a_limit_or_at_half_a_turn(
    limits: tuple[float, float], ends: tuple[float, float], tmp_path: Path
) -> None:
    """θ₃, at 0.4 rad, does not move the tool, so that c is its angle from there."""
    text = planar_urdf([0.5, 0.4, 0.0]).split('name="theta3"')
    for old, new in zip(("-7.0", "7.0"), limits, strict=True):
        text[1] = text[1].replace(f'"{old}"', f'"{new}"', 1)
    (tmp_path / "arm.urdf").write_text('name="theta3"'.join(text), encoding="utf-8")
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "xy")
    q = [0.3, 0.9, 0.4]
    design = designed(rp.Cell(task, task.placement(q), 0.05), q)
    F, x = design.function, design.cell.at(np.array([0.3, -0.4]))
    way = F(x, leaf=[1e-3])[2] - F(x)[2]  # c may count the other way
    (found,) = np.sign(way) * F.leaves(x)
    assert np.allclose(np.sort(found), ends, atol=1e-6)


@pytest.mark.slow
def test_leaves_end_where_the_leaf_margin_falls_to_a_tenth(tmp_path: Path) -> None:
    """The self-motion is followed by small steps of the null vector; n_ref of another length counts
    c in another unit."""
    task, q = planar_task([0.52, 0.36, 0.27], tmp_path), [0.4, -1.01, 0.86]
    chart = designed(rp.Cell(task, task.placement(q), 0.03), q, samples=16).function.chart
    u = np.array([0.3, -0.4])
    x, (q_ref, n) = chart.cell.at(u), (part[0] for part in chart.reference(u[None]))
    n = n[:, 0] / np.linalg.norm(n)
    ends = []
    for way in (-1, 1):
        q, margin = rp.InverseFunction(chart)(x), 1.0
        while margin > 0.1:
            N = np.linalg.svd(task.jacobian(q))[2][-1]
            margin = abs(N @ n)
            q = q + 2e-3 * way * np.sign(N @ n) * N
            q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, x)
        ends.append(n @ (q - q_ref))
    for length in (1.0, 0.2):
        scaled = chart.coefficients.copy()
        scaled[:, :, 1] *= length
        unit = length * np.linalg.norm(chart.reference(u[None])[1])
        F = rp.InverseFunction(replace(chart, coefficients=scaled))
        assert F.leaves(x)[0] / unit == pytest.approx(ends, abs=2e-3)


def test_what_a_design_says_of_itself() -> None:
    """The numbers of its evaluation in a person's words, what was asked for by default, and its
    rank among others."""
    design = found()
    j, said = design.evaluation, design.figures()
    assert (
        design.requested_limit_margin,
        design.requested_body_distance,
        design.requested_sigma_min,
    ) == (0.05, 0.0, 0.0)
    assert said["extra joint speed"].startswith(
        f"{100 * j.extra_speed:.3g} % ± {100 * j.extra_speed_error:.1g} on average, "
    )
    assert said["coverage"] == "100 %" and f"{j.limit_margin:.3g}" in said["limit margin"]
    assert (
        f"{100 * j.body_distance:.3g} cm" in said["body distance"]
        and "no" not in said["body distance"].split()
    )
    small = replace(design, posture=[0.012345, -1e-6, 1.23456, -2, 30, 4e-5, -0.04])
    assert small.figures()["posture"] == "0.0123, 0, 1.235, -2, 30, 0, -0.04 rad"
    errors = replace(j, extra_speed_error=0.00945, body_distance=0.1235)
    said = replace(design, evaluation=errors).figures()
    assert " % ± 0.9 on average, " in said["extra joint speed"]
    assert said["body distance"].startswith("12.3 cm, " + " and ".join(j.nearest_bodies))
    assert said["limit margin"].count("best possible there by self-motion") == 2
    cell = cell_of("position")
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    more = rp.InverseFunction(chart_of(cell, q, 1, 16))
    said = replace(design, function=more).figures()["limit margin"]
    assert said.count("best found there on other leaves") == 2
    free = replace(design, evaluation=replace(j, body_distance=np.inf, limit_margin=np.inf))
    assert (
        free.figures()["body distance"] == "no collision bodies"
        and free.figures()["limit margin"] == "no limits"
    )


def test_the_final_chart_is_the_function() -> None:
    """Its q_ref is so near that Newton's method takes two steps, at any pose of the cell."""
    design = found()
    U = design.cell.sample(500, 21)
    chart = design.function.chart
    assert np.abs(chart.reference(U)[0] - design.function.batch(U)).max() < 6e-5


@pytest.mark.parametrize(
    ("half_width", "affine"), [pytest.param(0.1, True, marks=pytest.mark.slow), (0.3, False)]
)
def test_the_fibres_are_as_simple_as_the_null_spaces_allow(
    half_width: float, affine: bool, tmp_path: Path
) -> None:
    """n_ref stays within 2.6° of the null space, and is affine in u where that is enough."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), [0.6, -1.2, 1.4]
    cell = rp.Cell(task, task.placement(q), half_width)
    F = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        posture=q,
        degree=2,
        options=rp.FitOptions(samples=32, held_out=64),
    ).function
    U = cell.sample(200, 21)
    n = F.chart.reference(U)[1][:, :, 0]
    null = [np.linalg.svd(task.jacobian(at))[2][-1] for at in F.batch(U)]
    cosines = np.abs((n * null).sum(axis=1)) / np.linalg.norm(n, axis=1)
    assert cosines.min() > 0.999
    opposite, middle_ = (F.chart.reference(V)[1][:, :, 0] for V in (-U, 0 * U))
    assert np.allclose(n + opposite, 2 * middle_, atol=1e-12) == affine


def test_the_judgement_is_honest() -> None:
    """Measured anew, pose by pose, from the function and its control alone; and what it says of
    its errors, on poses of our own."""
    design = found()
    j, task, count = design.evaluation, design.task, design.held_out
    U = design.cell.sample(count, design.seed + 2)
    Q = design.function.batch(U)
    G, G_d = design.inverse.batch(Q)[:, :, :3], design.desired.batch(Q)[:, :, :3]
    own, wanted, off = ((X**2).sum(axis=(1, 2)) for X in (G, G_d, G - G_d))
    assert j.cost == pytest.approx(off.mean(), rel=1e-6)
    ratio = own.mean() / wanted.mean()
    assert j.extra_speed == pytest.approx(np.sqrt(ratio) - 1, rel=1e-6)
    assert 0 < j.extra_speed < 0.002 and j.coverage == 1.0
    error = (own - ratio * wanted).std() / wanted.mean() / np.sqrt(count)
    assert j.extra_speed_error == pytest.approx(error / (2 * np.sqrt(ratio)), rel=1e-4)
    assert j.cost_error == pytest.approx(off.std() / np.sqrt(count), rel=1e-4)
    assert j.limit_margin == pytest.approx(
        np.minimum(Q - task.lower, task.upper - Q).min(), rel=1e-9
    )
    more = design.function.batch(design.cell.sample(1024, 77))
    gaps = design.inverse.batch(more) - design.desired.batch(more)
    others = (gaps[:, :, :3] ** 2).sum(axis=(1, 2))
    assert abs(design.cost - others.mean()) < 3 * (j.cost_error + others.std() / 32)
    assert j.limit_margin_worst <= min(j.limit_margin, j.attainable_margin_worst)
    assert j.attainable_margin >= j.limit_margin
    bodies, every = (
        rp.Bodies(task),
        np.concatenate([Q, design.function.batch(design.cell.corners())]),
    )
    distances = bodies.distances(every)
    assert 0.05 < j.body_distance <= distances.min() + 1e-9
    assert j.smallest_singular_value <= np.linalg.svd(task.jacobians(Q), compute_uv=False).min()


@pytest.mark.parametrize("posture", some([(-1.9, 1.0, 1.0), (1.9, -1.0, -1.2)], (-1.9, 1.0, 1.0)))
def test_the_attainable_margin_is_the_largest_of_the_self_motion(
    posture: tuple[float, ...], tmp_path: Path
) -> None:
    """Followed by small steps of the null vector from the worst held-out pose, both ways."""
    (tmp_path / "arm.urdf").write_text(planar_urdf([1.0, 0.9, 0.8], range_=2.0))
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "xy")
    cell = rp.Cell(task, task.placement(posture), 0.01)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        posture=posture,
        degree=1,
        limit_margin=0.0,
        options=rp.FitOptions(samples=16, held_out=64),
    )
    Q = design.function.batch(cell.sample(64, 2))
    worst = Q[np.argmin(task.limit_margin(Q).min(axis=1))]
    x, most, ahead = task.placement(worst), 0.0, np.zeros(3)
    for way in (1.0, -1.0):
        q, ahead = worst, way * np.linalg.svd(task.jacobian(worst))[2][-1]
        while task.limit_margin(q).min() >= 0:
            most = max(most, task.limit_margin(q).min())
            N = np.linalg.svd(task.jacobian(q))[2][-1]
            ahead = N * np.sign(N @ ahead)
            q = q + 2e-3 * ahead
            q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, x)
    found = design.evaluation.attainable_margin
    assert found == pytest.approx(most, abs=2e-3)
    assert found > design.limit_margin + 0.2


def test_the_worst_pose_is_found_by_search(tmp_path: Path) -> None:
    """As on a grid that becomes finer around it, from few poses, and at no corner: limits, σ_min,
    and joint speeds of all task directions and of one."""
    task = planar_task([1.0, 0.9, 0.8], tmp_path)
    x = pin.SE3(np.eye(3), np.array([1.43, 0.0, 0.0]))
    q = rp.solve_ik(task, [0.93, 0.41, -0.85], x)
    design = designed(rp.Cell(task, x, (0.46, 0.55)), q, degree=2, samples=64)
    j, grid = (design.evaluation, np.array(list(product(np.linspace(-1, 1, 21), repeat=2))))

    def figures(U: np.ndarray) -> tuple[np.ndarray, ...]:
        Q = design.function.batch(U)
        G, G_d = design.inverse.batch(Q), design.desired.batch(Q)
        return (
            -task.limit_margin(Q).min(axis=1),
            -np.linalg.svd(task.jacobians(Q), compute_uv=False).min(axis=1),
            np.linalg.norm(G, axis=(1, 2)) / np.linalg.norm(G_d, axis=(1, 2)) - 1,
            np.linalg.norm(G @ np.linalg.pinv(G_d), 2, axis=(1, 2)) - 1,
        )

    found = (
        -j.limit_margin_worst,
        -j.smallest_singular_value,
        j.extra_speed_worst,
        j.extra_speed_direction,
    )
    coarse = figures(grid)
    for i, value in enumerate(found):
        u = grid[coarse[i].argmax()]
        for near in (0.1, 0.005):
            U = np.clip(u + near * grid, -1, 1)
            finer = figures(U)[i]
            u, most = U[finer.argmax()], finer.max()
        assert np.abs(u).min() < 0.99
        assert value == pytest.approx(most, rel=1e-4)


@pytest.mark.slow
def test_the_largest_joint_speeds_of_a_cell_are_found_by_search() -> None:
    """No pose of many, and no corner, costs more than is said: all task directions together, and
    one alone."""
    design = found(0.25)
    cell, task, rng = design.cell, design.task, np.random.default_rng(3)
    U = np.concatenate([cell.corners(), np.sign(cell.sample(400, 5)), cell.sample(400, 6)])
    Q = design.function.batch(U)
    G, G_d = design.inverse.batch(Q), design.desired.batch(Q)
    E = cell.twists(U, np.array([task.placement(q).rotation for q in Q])) @ cell.speeds(U)
    own, wanted = G @ E, G_d @ E
    whole = np.linalg.norm(own, axis=(1, 2)) / np.linalg.norm(wanted, axis=(1, 2)) - 1
    xdot = rng.normal(size=(task.m, 2000))
    single = np.linalg.norm(G @ xdot, axis=1) / np.linalg.norm(G_d @ xdot, axis=1) - 1
    assert whole.max() <= design.extra_speed_worst + 1e-9 and whole[:64].max() > 2 * np.median(
        whole
    )
    assert single.max() <= design.extra_speed_direction + 1e-9
    assert 0.8 * design.extra_speed_direction < single.max()  # and it is there
    assert (
        f"{100 * design.extra_speed_direction:.3g} % at most in a single task direction"
        in design.summary()
    )


def test_the_smallest_distance_between_bodies_is_found_by_search() -> None:
    """On an edge of the cell that is no corner, and where few held-out poses come near."""
    cell = rp.Cell(panda(), middle(), (0.1, 0.2, 0.1), 0.2)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(panda()), cell, posture=rp.solve_ik(panda(), Q_PANDA, middle()),
        degree=2, options=rp.FitOptions(samples=128, held_out=64),
    )  # fmt: skip
    U = np.tile([-1, 0, -1, -1, -1, 1.0], (21, 1))
    U[:, 1] = np.linspace(-1, 1, 21)
    along = rp.Bodies(panda()).distances(design.function.batch(U))
    assert design.body_distance <= along.min() + 1e-4 < along[[0, -1]].min() - 1e-3


@pytest.mark.slow
def test_what_was_asked_for_and_is_not_met_is_said(tmp_path: Path) -> None:
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), [0.3, 0.5, 2.4]
    cell = rp.Cell(task, task.placement(q), 0.2)
    small = {"posture": q, "degree": 1, "options": rp.FitOptions(samples=32, held_out=64)}
    asked = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, sigma_min=9.0, **small)
    assert "the requested 9 is not met" in asked.figures()["σ_min(J)"]
    plain = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, **small)
    assert "asked for" not in plain.summary()
    design = found()
    for figure, asked, value in (
        ("body distance", "requested_body_distance", design.body_distance),
        ("limit margin", "requested_limit_margin", design.limit_margin_worst),
    ):
        near, met = (replace(design, **{asked: a}) for a in (value + 0.5, value))
        says = f"; the requested {value + 0.5:g} is not met"
        assert near.figures()[figure].endswith(says)
        assert "not met" not in met.figures()[figure]


@pytest.mark.slow
def test_the_degree_goes_on_where_only_a_higher_one_lowers_the_cost() -> None:
    """PPR: degrees 2 and 3 bring nothing, degree 4 a sixth of the cost."""
    task = rp.Robot.load("ppr").task("tool", "xy")
    cell = rp.Cell(task, task.placement(task.reference), 0.5)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, options=rp.FitOptions(held_out=256)
    )
    assert design.samples > 200  # of 256, and no fewer than a quick design's
    costs = dict(design.degrees)
    assert costs[3] > 0.99 * costs[1] > 1.1 * costs[4] and list(costs) == [1, 2, 3, 4]


@pytest.mark.slow
def test_the_degrees_are_as_low_as_the_function_allows(tmp_path: Path) -> None:
    """The degree of s stays 1 if the extra joint speed is below 0.01 %. The last chart has the
    lowest degree from 3 up whose q_ref is within 3e-5 of F."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), [0.6, -1.2, 1.4]
    for half_width, degree in ((0.02, 3), (0.12, None)):
        cell = rp.Cell(task, task.placement(q), half_width)
        auto: Any = "auto" if degree else 1
        design = designed(cell, q, degree=auto)
        assert [d for d, _ in design.degrees] == [1]
        assert design.extra_speed < 1e-4 or degree is None
        chart, U = design.function.chart, cell.sample(512, 21)
        Q = design.function.batch(U)
        assert np.abs(chart.reference(U)[0] - Q).max() < 6e-5
        if degree:
            assert chart.monomials.degree == degree
            continue
        assert chart.monomials.degree > 3
        low = chart_of(cell, np.array(q), chart.monomials.degree - 1, 32).monomials
        assert np.abs(low.values(U) @ low.fit(U, Q) - Q).max() > 3e-5


@pytest.mark.slow
def test_limits_in_the_cost_keep_the_joints_inside(tmp_path: Path) -> None:
    task = planar_task([1.0, 0.9, 0.8], tmp_path)
    x = task.placement([0.6, -1.2, 1.4])
    cell = rp.Cell(task, x, 0.35)
    q = rp.solve_ik(task, [0.6, -1.2, 1.4], x)
    small = {"posture": q, "degree": 2, "options": rp.FitOptions(samples=64, held_out=256)}
    free = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, **small)
    Q = free.function.batch(cell.sample(256))
    bound = float(Q[:, 2].max()) - 0.05  # a joint limit where the free function goes beyond it
    text = (tmp_path / "planar3.urdf").read_text().split('name="theta3"')
    text[1] = text[1].replace('upper="7.0"', f'upper="{bound}"', 1)
    (tmp_path / "bound.urdf").write_text('name="theta3"'.join(text))
    task = rp.Robot.load(tmp_path / "bound.urdf").task("tool", "xy")
    cell = rp.Cell(task, x, 0.35)
    kept = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, **small)
    assert kept.limit_margin > 0.02 and kept.coverage == 1.0
    assert kept.evaluation.attainable_margin_worst >= kept.limit_margin_worst > 0.0
    assert kept.cost > free.cost


@pytest.mark.slow
def test_a_margin_that_no_near_leaf_has_does_not_cost_coverage(tmp_path: Path) -> None:
    """The share of poses that any configuration inside the limits reaches, by the law of cosines
    for the last two links at every θ₁, is that of F."""
    l1, l2, l3 = lengths = [0.36, 0.59, 1.0]
    limits = np.array([[-2.11, 1.52], [-1.99, -1.35], [-1.72, -1.24]])
    text = planar_urdf(lengths).split('lower="-7.0" upper="7.0"')
    bounds = [f'lower="{low}" upper="{high}"' for low, high in limits]
    parts = [text[0], *(b + t for b, t in zip(bounds, text[1:], strict=True))]
    (tmp_path / "bounded.urdf").write_text("".join(parts), encoding="utf-8")
    task = rp.Robot.load(tmp_path / "bounded.urdf").task("tool", "xy")
    q = [1.44, -1.47, -1.65]
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Cell(task, task.placement(q), 0.06),
        posture=q,
        degree=2,
        limit_margin=0.2,
        incomplete="keep",
        options=rp.FitOptions(samples=32, held_out=64),
    )
    U = design.cell.sample(512, 3)
    covered = np.isfinite(design.function.batch(U, missing="nan")).all(axis=1)
    first = np.linspace(*limits[0], 1001)
    knee = l1 * np.stack([np.cos(first), np.sin(first)], axis=1)
    x, y = np.moveaxis(design.cell.placements(U)[0][:, None, :2] - knee, 2, 0)
    cosine = (x**2 + y**2 - l2**2 - l3**2) / (2 * l2 * l3)
    third = -np.arccos(np.clip(cosine, -1, 1))  # its range is below 0
    way = np.arctan2(y, x) - np.arctan2(l3 * np.sin(third), l2 + l3 * np.cos(third))
    second = (way - first + np.pi) % (2 * np.pi) - np.pi
    inside = np.abs(cosine) <= 1
    for angle, (low, high) in ((second, limits[1]), (third, limits[2])):
        inside &= (low <= angle) & (angle <= high)
    assert covered.mean() == pytest.approx(inside.any(axis=1).mean(), abs=0.01)


@pytest.mark.slow
def test_bodies_in_the_cost_are_kept_apart(tmp_path: Path) -> None:
    """A post beside the forearm: under J⁺'s own section it is touched, with bodies in the cost it
    is not."""
    (tmp_path / "post.urdf").write_text(
        '<robot name="post"><link name="post"><collision><origin xyz="0.2 0.185 0.6"/>'
        '<geometry><box size="0.1 0.1 0.1"/></geometry></collision></link></robot>'
    )
    task = rp.Robot.load("panda", surroundings=tmp_path / "post.urdf").task(
        "panda_hand_tcp", "position"
    )
    cell = rp.Cell(task, middle(), 0.08)
    small = {
        "posture": rp.solve_ik(panda(), Q_PANDA, middle()),
        "degree": 2,
        "options": rp.FitOptions(samples=64, held_out=128),
    }
    free, kept = (
        rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, body_distance=a, **small)
        for a in (0.0, 0.02)
    )
    assert free.body_distance < 0
    (stop,) = (one for one in free.failures if one.cause == "collision")
    links = rp.Bodies(task).nearest(free.function(cell.at(stop.u))).links
    assert str(stop) == f"at {cell.where(stop.u)}, {links[0]} and {links[1]} collide"
    every = free.function.batch(np.concatenate([cell.sample(128, 2), cell.corners()]))
    apart = rp.Bodies(task).distances(every)
    assert stop.share == pytest.approx((apart < 0).mean()) and "post" in links
    at_worst = rp.Bodies(task).distances(free.function(cell.at(stop.u))[None])
    assert free.body_distance == pytest.approx(at_worst[0], abs=1e-9)
    assert at_worst <= apart.min() + 1e-9
    assert kept.body_distance > 0.01 and not kept.failures
    assert "post" in kept.evaluation.nearest_bodies and kept.extra_speed < 0.001
    Q = kept.function.batch(cell.sample(100, 31))
    anywhere = np.random.default_rng(0).uniform(task.lower, task.upper, (50, task.n))
    bodies, Q = (
        rp.Bodies(task),
        np.concatenate([Q, free.function.batch(cell.corners()), anywhere]),
    )
    distances, hulls = bodies.distances(Q), bodies.hull_distances(Q)
    assert (
        distances[:100].min() > 0.01
        and (hulls[distances <= 0] <= 0).all()
        and (hulls < -0.001).any()
    )
    assert np.allclose(hulls[distances > 0], distances[distances > 0])


@pytest.mark.slow
def test_another_posture_is_used_where_the_first_one_collides(tmp_path: Path) -> None:
    """A post that the first link sweeps over between the middle and the corners; the arm has two
    postures, and the search offers that one first."""
    text = planar_urdf([1.0, 0.8, 0.3], range_=3.0)
    for i, length in enumerate((1.0, 0.8, 0.3), 1):
        box = f'<origin xyz="{length / 2} 0 0"/><geometry><box size="{0.96 * length} 0.01 0.01"/>'
        bodies = f'<link name="link{i}"><collision>{box}</geometry></collision></link>'
        text = text.replace(f'<link name="link{i}"/>', bodies)
    *before, last = re.split('(lower="-3.0" upper="3.0")', text)
    before[-1] = 'lower="-0.1" upper="0.1"'  # so that no other postures are between the two
    (tmp_path / "arm.urdf").write_text("".join([*before, last]))
    x, y = 0.93 * np.cos(0.85), -0.93 * np.sin(0.85)
    (tmp_path / "post.urdf").write_text(
        f'<robot name="post"><link name="post"><collision><origin xyz="{x} {y} 0"/>'
        '<geometry><box size="0.01 0.01 0.05"/></geometry></collision></link></robot>'
    )
    around = tmp_path / "post.urdf"
    robot = rp.Robot.load(tmp_path / "arm.urdf", surroundings=around)
    task, middle = robot.task("tool", "xy"), pin.SE3(np.eye(3), np.array([1.3, 0.3, 0]))
    cell = rp.Cell(task, middle, 0.12)
    found, first = (
        rp.nearest_inverse_function(
            rp.Pseudoinverse(task),
            cell,
            posture=posture,
            degree=2,
            limit_margin=0.02,
            options=rp.FitOptions(samples=64, held_out=128),
        )
        for posture in (None, rp.solve_ik(task, [-0.71, 1.77, 0.0], middle))
    )
    near = np.concatenate([cell.corners(), np.zeros((1, 2))])
    apart = rp.Bodies(task).distances(first.function.batch(near))
    assert first.body_distance < 0 < apart.min()
    assert found.body_distance > 0.5 and found.posture[1] < 0 < first.posture[1]


@pytest.mark.slow
def test_singularities_in_the_cost_are_kept_away(tmp_path: Path) -> None:
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), [0.3, 0.5, 2.4]
    cell = rp.Cell(task, task.placement(q), 0.2)
    small = {"posture": q, "degree": 2, "options": rp.FitOptions(samples=64, held_out=128)}
    free, kept = (
        rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, sigma_min=a, **small)
        for a in (0.0, 0.9)
    )
    U = cell.sample(200, 31)
    jacobians = [task.jacobians(d.function.batch(U)) for d in (free, kept)]
    least = [np.linalg.svd(J, compute_uv=False).min() for J in jacobians]
    assert least[0] < 0.6 and least[1] > 0.85 and kept.extra_speed < 0.01


@pytest.mark.parametrize(("n", "seed"), [(4, 5), pytest.param(6, 3, marks=pytest.mark.slow)])
def test_arms_with_slides_and_more_joints_than_one_too_many(
    n: int, seed: int, tmp_path: Path
) -> None:
    task = spatial_task(n, tmp_path, seed=seed)
    q = 0.4 * np.ones(n)
    cell = rp.Cell(task, task.placement(q), 0.05)
    design = designed(cell, q, degree=2, samples=64)
    assert (
        design.coverage == 1.0 and design.extra_speed < 0.03 and design.evaluation.residual < 1e-9
    )
    Q = design.function.batch(cell.sample(8))
    assert np.allclose([design.function(task.placement(q)) for q in Q], Q, atol=1e-9)


def test_an_arm_without_limits(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """And no progress bar, unless it is asked for."""
    text = planar_urdf([1.0, 0.9, 0.8]).replace('type="revolute"', 'type="continuous"')
    (tmp_path / "endless.urdf").write_text(text, encoding="utf-8")
    task = rp.Robot.load(tmp_path / "endless.urdf").task("tool", "xy")
    cell = rp.Cell(task, task.placement([0.6, -1.2, 1.4]), 0.1)
    design = designed(cell, [0.6, -1.2, 1.4])
    assert capfd.readouterr() == ("", "")
    assert (
        design.limit_margin == design.limit_margin_worst == np.inf
        and "no limits" in design.summary()
    )
    again = rp.load(rp.save(design, tmp_path / "cell.json"), task)
    assert isinstance(again, rp.CellDesign) and again.limit_margin_worst == np.inf


def test_functions_pickle_and_repeat_bit_for_bit() -> None:
    F = found().function
    again = pickle.loads(pickle.dumps(F))
    x = F.cell.at(np.array([0.1, 0.7, -0.3]))
    assert (again(x) == F(x)).all()


@pytest.mark.parametrize(
    ("ratio", "text"),
    [(0.000899, "0.0899 %"), (0.4567, "45.7 %"), (3.1623, "316 %"), (12.3456, "1235 %")],
)
def test_no_extra_speed_is_written_with_an_exponent(ratio: float, text: str) -> None:
    design = found()
    worst = replace(design.evaluation, extra_speed_worst=ratio)
    assert f" {text} at the worst pose" in replace(design, evaluation=worst).summary()


# ---- what cannot be
# ----------------------------------------------------------------------------------


def refused(cell: rp.Cell, posture: object = None, **options: object) -> str:
    with pytest.raises(rp.InputError) as caught:
        designed(cell, posture, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_middle_out_of_reach(tmp_path: Path) -> None:
    """By how much, for an arm that reaches 1.2 m."""
    assert "is out of reach" in refused(
        rp.Cell(panda(), pin.SE3(middle().rotation, np.array([1.5, 0, 0.4])), 0.1)
    )
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    far = pin.SE3(np.eye(3), np.array([0.9, 1.2, 0.0]))
    found = re.search(r"found for .* is ([\d.]+) m or rad", refused(rp.Cell(task, far, 0.1)))
    assert found is not None and float(found[1]) == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("side", [1, -1])
def test_a_middle_beyond_the_limits_names_the_joint_and_the_least_violation(
    side: int, tmp_path: Path
) -> None:
    """As near to its base as 0.9 rad in each joint bring it, a hand of ±0.5 rad does not come.
    Newton's method ends where the squares of what each joint exceeds ±0.4 rad by are least."""
    l1, l2, l3 = lengths = np.array([1.0, 0.9, 0.8])
    (tmp_path / "narrow.urdf").write_text(planar_urdf(lengths, range_=0.5))
    task = rp.Robot.load(tmp_path / "narrow.urdf").task("tool", "xy")
    middle = task.placement(side * np.full(3, 0.9))
    says = refused(rp.Cell(task, middle, 0.05))
    found = re.search(r"outside the limits of '(theta\d)', by ([\d.]+) rad in the best", says)
    assert found is not None, says
    # all configurations of that pose, by the law of cosines for the last two links at each θ₁
    first = np.linspace(-np.pi, np.pi, 20001)
    x, y = middle.translation[:2, None] - l1 * np.stack([np.cos(first), np.sin(first)])
    cosine = (x**2 + y**2 - l2**2 - l3**2) / (2 * l2 * l3)
    ends = []
    for way in (1, -1):
        third = way * np.arccos(np.clip(cosine, -1, 1))
        ahead = np.arctan2(y, x) - np.arctan2(l3 * np.sin(third), l2 + l3 * np.cos(third))
        second = (ahead - first + np.pi) % (2 * np.pi) - np.pi
        beyond = np.abs([first, second, third]) - 0.5
        squares = (np.maximum(0, beyond + 0.1) ** 2).sum(axis=0)
        squares[np.abs(cosine) > 1] = np.inf
        least = np.minimum(np.roll(squares, 1), np.roll(squares, -1))
        ends += beyond.T[(squares < least)].tolist()
    best = min(ends, key=max)
    assert float(found[2]) == pytest.approx(max(best), abs=2e-3)
    assert found[1] == f"theta{int(np.argmax(best)) + 1}"


def corner_out_of_reach(folder: Path) -> rp.Cell:
    """The arm reaches 2.7 m; two corners of the cell are at 2.72 m, and no held-out pose of a few
    is beyond 2.69."""
    task = planar_task([1.0, 0.9, 0.8], folder)
    return rp.Cell(task, pin.SE3(np.eye(3), np.array([1.9, 0.0, 0.0])), (0.72, 0.72))


@pytest.mark.slow
def test_a_broken_corner_refuses_a_cell_and_is_not_called_covered(tmp_path: Path) -> None:
    """All held-out poses have joints, a corner has none: refused; if kept, nothing says 100 %."""
    cell = corner_out_of_reach(tmp_path)
    task = cell.task
    small = {
        "posture": rp.solve_ik(task, [-0.6, 1.0, 0.4], cell.placement),
        "degree": 1,
        "options": rp.FitOptions(samples=64, held_out=64),
    }
    told: list[tuple[str, float]] = []
    with pytest.raises(rp.NoFunctionError, match="is out of reach") as caught:
        rp.nearest_inverse_function(
            rp.Pseudoinverse(task),
            cell,
            progress=lambda what, share: told.append((what, share)),
            **small,
        )
    words = [what for what, share in told if 0 <= share <= 1]
    first = ["the middle posture", "the reference", "degree 1", "the last chart"]
    assert len(words) == len(told) and [w for w in words if w in first][:4] == first
    most = np.roots([2 * 0.72**2, 2 * 0.72 * 1.9, 1.9**2 - 2.7**2]).max()
    tried = [float(w.split()[-2]) for w in words if w.startswith("scale that fits")]
    bisected = [50, 75, 87.5, 93.75, 96.875]  # the last one fits
    assert np.allclose(tried, bisected, rtol=0, atol=0.5) and 0.96875 < most < 0.985
    assert caught.value.fits == 0.96875
    assert caught.value.partly and "incomplete='keep'" in str(caught.value)
    told.clear()
    kept = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        incomplete="keep",
        progress=lambda what, share: told.append((what, share)),
        **small,
    )
    words, shares = zip(*told, strict=True)
    assert "degree 1" in words and list(shares) == sorted(shares)
    assert all(0 <= share <= 1 for share in shares)
    assert kept.extra_speed_direction >= kept.extra_speed_worst >= kept.extra_speed
    assert kept.coverage == 1.0 and not kept.evaluation.everywhere
    assert kept.figures()["coverage"] == "all held-out poses, but not every pose"
    assert "out of reach" in kept.figures()["stopped"]
    assert "100" not in kept.figures()["coverage"] + repr(kept)
    smaller = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, incomplete="shrink", **small | {"degree": 3}
    )
    F = smaller.function
    assert smaller.degrees[-1][0] == 3  # not that of a quick design
    assert smaller.evaluation.everywhere and len(F.batch(smaller.cell.corners())) == 8


def test_a_limit_broken_at_a_corner_refuses_a_cell(tmp_path: Path) -> None:
    """The held-out poses keep the limits, the search finds one that does not: no single joint says
    otherwise."""
    design = found()
    j = replace(design.evaluation, limit_margin_worst=-0.25)
    assert j.coverage == 1.0 and not j.everywhere and "100" not in j.covered
    assert replace(design.evaluation, limit_margin_worst=0.0).everywhere
    almost = replace(design.evaluation, coverage=0.99999)
    assert almost.covered == "99.99 % of the held-out poses"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"degree": 0}, "degree must be a whole number from 1 up"),
        ({"degree": 10**12}, "degree can be at most 12"),
        ({"options": rp.FitOptions(samples=10**6)}, "samples can be at most 65,536"),
        ({"options": rp.FitOptions(held_out=2 * 10**6)}, "held_out can be at most 1,048,576"),
        ({"sigma_min": 1e300}, r"sigma_min can be at most 1e\+06"),
        ({"limit_margin": 1e300}, r"limit_margin can be at most 1e\+06"),
        ({"body_distance": -1}, "body_distance must be 0 m or more"),
        ({"limit_margin": 1e6, "sigma_min": -1}, "sigma_min must be 0 or more"),
    ],
)
def test_options_have_bounds(options: dict, says: str) -> None:
    with pytest.raises(rp.InputError, match=says):
        rp.nearest_inverse_function(rp.Pseudoinverse(panda()), cell_of(), **options)


def test_an_arm_without_redundancy_has_no_choice(tmp_path: Path) -> None:
    task = planar_task([1.0, 0.9], tmp_path)
    cell = rp.Cell(task, task.placement([0.3, 0.8]), 0.1)
    with pytest.raises(rp.InputError, match="is not redundant: with r = 0 the pose"):
        rp.nearest_inverse_function(rp.Pseudoinverse(task), cell)


def test_a_degree_has_at_most_so_many_unknowns() -> None:
    """Those of the polynomials of degree d in three coordinates, times r = 4."""
    cell = cell_of("position")
    with pytest.raises(rp.InputError, match="more than 1040 unknowns; lower"):
        rp.nearest_inverse_function(rp.Pseudoinverse(cell.task), cell, degree=10)


@pytest.mark.slow
def test_a_cell_that_reaches_too_far_and_what_would_fit(tmp_path: Path) -> None:
    """Collisions with a post in the middle of it do not make it incomplete, and are not named."""
    (tmp_path / "post.urdf").write_text(
        '<robot name="post"><link name="post"><collision><origin xyz="0.6 0 0.2"/>'
        '<geometry><box size="0.2 0.2 0.2"/></geometry></collision></link></robot>'
    )
    task = rp.Robot.load("panda", surroundings=tmp_path / "post.urdf").task(
        "panda_hand_tcp", "pose"
    )
    x = pin.SE3(middle().rotation, np.array([0.6, 0.0, 0.4]))
    q = rp.solve_ik(panda(), Q_PANDA, x)
    with pytest.raises(rp.NoFunctionError) as error:
        rp.nearest_inverse_function(
            rp.Pseudoinverse(task),
            rp.Cell(task, x, 0.35),
            posture=q,
            degree=1,
            options=rp.FitOptions(samples=32, held_out=64),
        )
    says = str(error.value)
    assert "no single function covers the cell" in says and "collide" not in says
    assert "reach" in says and "to move its sides inward" in says
    assert "collision" not in [one.cause for one in error.value.failures]


@pytest.mark.slow
def test_a_cell_beyond_the_joint_limits_and_one_through_a_singularity(tmp_path: Path) -> None:
    (tmp_path / "narrow.urdf").write_text(
        planar_urdf([1.0, 0.9, 0.8], range_=1.0), encoding="utf-8"
    )
    narrow = rp.Robot.load(tmp_path / "narrow.urdf").task("tool", "xy")
    q = [-0.5, 0.9, 0.6]
    cell = rp.Cell(narrow, narrow.placement(q), 0.35)
    says = refused(cell, q)
    assert re.search(
        r"at \(1\.\d+, .*\) m, theta\d is [\d.]+ rad beyond its limit; "
        r"use incomplete=.shrink. to move its sides inward",
        says,
    ), says
    # folded together, it has no way outward along its links
    task = planar_task([1.0, 0.9, 0.8], tmp_path)
    x = pin.SE3(np.eye(3), np.array([0.9, 0.0, 0.0]))
    says = refused(
        rp.Cell(task, x, (0.3, 0.1)), rp.solve_ik(task, [0.0, np.pi - 0.15, np.pi + 0.15], x)
    )
    assert re.search(
        r"between the middle of the cell and \(.*\) m the arm passes a singularity", says
    ), says


@pytest.mark.slow
def test_a_slide_beyond_its_limit_is_named_at_its_worst_pose(tmp_path: Path) -> None:
    """In metres, and as far as the function without limits goes at that pose."""
    old, new = (f'"1 0 0"/><limit lower="-{x}" upper="{x}"' for x in ("3", "0.1"))
    sliding_task(tmp_path)
    text = (tmp_path / "sliding.urdf").read_text()
    (tmp_path / "short.urdf").write_text(text.replace(old, new))
    task, q = (rp.Robot.load(tmp_path / "short.urdf").task("l5", "xy"), [0.3, 0, 0.5, 0.2, 0.4])
    cell = rp.Cell(task, task.placement(q), 0.15)
    design = designed(cell, q, incomplete="keep")
    (stop,) = design.failures
    free = rp.InverseFunction(design.function.chart, keep_limits=False)
    margin = task.limit_margin(free(cell.at(stop.u)))
    assert stop.cause == "limit" and np.argmin(margin) == 1
    assert stop.what == f"at {cell.where(stop.u)}, j1 is {-margin[1]:.2g} m beyond its limit"
    everywhere = task.limit_margin(free.batch(cell.sample(256, 5))).min()
    assert margin[1] <= everywhere + 1e-6


def test_poses_out_of_reach_and_beyond_a_singularity_are_two_causes(tmp_path: Path) -> None:
    """Out of reach are those farther away than the three links together."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), [0.3, 0.5, 2.4]
    cell = rp.Cell(task, task.placement(q), 1.2)
    with pytest.raises(rp.NoFunctionError) as error:
        designed(cell, q)
    causes = {one.cause: one for one in error.value.failures}
    assert set(causes) == {"reach", "singularity"}
    away = {k: np.hypot(*cell.at(one.u).translation[:2]) for k, one in causes.items()}
    assert away["reach"] > 2.7 > away["singularity"]
    assert np.array_equal(causes["reach"].u, [1, 1])  # the farthest corner
    left = re.findall(r"task error ([\d.]+), in m and rad", causes["reach"].what)
    assert float(left[0]) == pytest.approx(away["reach"] - 2.7, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit_margin", "share"), [(0.05, 1.0), pytest.param(0.0, 0.8, marks=pytest.mark.slow)]
)
def test_the_cell_that_fits_is_the_largest_whose_corners_keep_the_limits(
    limit_margin: float, share: float, tmp_path: Path
) -> None:
    """Of 32 sizes, on the straight ways of J⁺ to the corners. Without a margin that is asked for,
    the function of such a cell goes beyond a limit, and the next size is 0.8 of it."""
    lengths = np.array([1.0, 0.9, 0.8])
    (tmp_path / "narrow.urdf").write_text(planar_urdf(lengths, range_=1.0))
    task = rp.Robot.load(tmp_path / "narrow.urdf").task("tool", "xy")
    q = np.array([-0.6, 0.8, 0.8])
    cell = rp.Cell(task, task.placement(q), 0.35)
    with pytest.raises(rp.NoFunctionError) as caught:
        designed(cell, q, limit_margin=limit_margin)

    def inside(factor: float) -> bool:
        here = np.tile(q, (4, 1))
        start, ends = (
            cell.placements(factor * U)[0][:, :2] for U in (np.zeros((4, 2)), cell.corners()[:4])
        )
        good = True
        for ahead in np.linspace(0, 1, 101)[1:]:
            hand = lengths @ np.exp(1j * np.cumsum(here, axis=1)).T
            gap = start + ahead * (ends - start) - np.stack([hand.real, hand.imag], 1)
            J_plus = np.linalg.pinv(task.jacobians(here))
            here = here + np.einsum("Knm,Km->Kn", J_plus, gap)
            good = good and np.abs(here).max() < 1
        return good

    largest = caught.value.fits / share
    assert inside(largest) and not inside(largest + 1 / 32)
    assert largest == pytest.approx(round(32 * largest) / 32)


@pytest.mark.slow
def test_the_causes_of_a_failure_have_their_shares(tmp_path: Path) -> None:
    """Fewer than half of the poses are reached at all, and most of those beyond the limits; the
    message begins with the cause of most."""
    lengths = np.array([1.0, 0.9, 0.8])
    (tmp_path / "narrow.urdf").write_text(planar_urdf(lengths, range_=1.0))
    task = rp.Robot.load(tmp_path / "narrow.urdf").task("tool", "xy")
    q, G_d = np.array([-0.5, 0.9, 0.6]), rp.Pseudoinverse(task)
    cell = rp.Cell(task, task.placement(q), 3.0)
    with pytest.raises(rp.NoFunctionError) as error:
        rp.nearest_inverse_function(
            G_d, cell, posture=q, degree=1, options=rp.FitOptions(samples=32, held_out=64)
        )
    beyond, out_of_reach = 0, 0
    for u in np.concatenate([cell.sample(32, 1), cell.corners()]):
        x = cell.at(u).translation[:2]
        if np.hypot(*x) > lengths.sum():
            out_of_reach += 1
            continue
        here, start = q.copy(), cell.placement.translation[:2]
        for ahead in np.linspace(0, 1, 401)[1:]:
            turns = np.cumsum(here)
            hand = lengths @ np.c_[np.cos(turns), np.sin(turns)]
            gap = start + ahead * (x - start) - hand
            here = here + np.linalg.pinv(task.jacobian(here)) @ gap
        beyond += np.abs(here).max() > 1
    shares = {one.cause: one.share for one in error.value.failures}
    assert shares == {"reach": out_of_reach / 32, "limit": beyond / 32}
    assert shares["reach"] > shares["limit"] > 0
    said = r"cell: the pose .* is out of reach .*, and at .* beyond its limit; "
    assert re.search(said, str(error.value))


def test_a_posture_that_does_not_lead_to_the_middle(tmp_path: Path) -> None:
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    far = rp.Cell(task, pin.SE3(np.eye(3), np.array([0.9, 1.2, 0.0])), 0.1)
    says = refused(far, [0.2, 0.8, 0.8])
    assert "posture" in says and "does not lead to the middle of the cell" in says


def test_a_middle_at_a_singularity(tmp_path: Path) -> None:
    """Of a given posture; and of all postures, where every joint slides along x."""
    task = planar_task([1.0, 0.9, 0.8], tmp_path)
    stretched = rp.Cell(task, task.placement([0.1, 0.0, 0.0]), 0.02)
    assert "the arm is at a singularity" in refused(stretched, [0.1, 0.0, 0.0])
    text = planar_urdf([0.5, 0.4, 0.3]).replace("revolute", "prismatic")
    (tmp_path / "slides.urdf").write_text(text.replace('xyz="0 0 1"', 'xyz="1 0 0"'))
    task = rp.Robot.load(tmp_path / "slides.urdf").task("tool", "xy")
    says = refused(rp.Cell(task, task.placement([0.1, 0.2, 0.3]), 0.02))
    assert says.startswith("in the middle of the cell, (1.8, 0, 0) m, the arm is at")


@pytest.mark.slow
def test_the_largest_cell_that_works() -> None:
    x = pin.SE3(middle().rotation, np.array([0.6, 0.0, 0.4]))
    q = rp.solve_ik(panda(), Q_PANDA, x)
    cell = rp.Cell(panda(), x, 0.35)
    smaller = rp.nearest_inverse_function(
        rp.Pseudoinverse(panda()),
        cell,
        posture=q,
        degree=1,
        options=rp.FitOptions(samples=32, held_out=64),
        incomplete="shrink",
    )
    assert smaller.coverage == 1.0 and 0.05 < smaller.cell.half_width[0] < 0.35


@pytest.mark.slow
def test_the_axis_of_the_first_joint_is_found_in_a_cell(tmp_path: Path) -> None:
    """Flat cells whose edge is a little on this side or the other of where the axis, which points
    anywhere, crosses them; none of a slide."""
    task = spatial_task(4, tmp_path, seed=1)
    point, axis = task.joint_origins(task.reference)[0], task.axes(task.reference)[0]
    tried = 0
    for flat, q in enumerate(np.random.default_rng(2).uniform(-2, 2, (7, 4))):
        flat %= 3
        middle = task.placement(q).translation
        t = (middle[flat] - point[flat]) / axis[flat]
        gap = np.abs(point + t * axis - middle)
        if tried >= 4 or not 0.3 < np.delete(gap, flat).min() < gap.max() < 1.5:
            continue
        for factor in (1.02, np.where(gap == gap.max(), 1.02, 0.98)):
            widths = np.where(np.arange(3) == flat, 1e-5, gap * factor)
            cell = rp.Cell(task, pin.SE3(np.eye(3), middle), widths)
            said = "contains the axis of q1," in refused(cell, q)
            assert said == np.isscalar(factor)
            tried += 1
    assert tried >= 4


def test_a_cell_round_the_base() -> None:
    """Also where the axis touches its edge, and runs beside it: it is parallel to two faces."""
    for y, inside in ((0.69, True), (-0.71, False)):
        x = pin.SE3(middle().rotation, np.array([0.0, y, 0.9]))
        cell = rp.Cell(panda("position"), x, (0.7, 0.7, 1e-5))
        says = refused(cell, rp.solve_ik(panda("position"), Q_PANDA, x))
        assert ("contains the axis of panda_joint1," in says) is inside, says
    slides = rp.Robot.load("ppr").task(None, "xy")
    assert "axis" not in refused(rp.Cell(slides, np.zeros(3), 9.0), np.zeros(3))


def test_targets_outside_and_other_wrong_things() -> None:
    design = found()
    F = design.function
    with pytest.raises(
        rp.InputError, match=r"lies outside the cell: y is \+0.15 m from the middle"
    ):
        F(design.cell.at(np.array([0.0, 1.5, 0.0])))
    turned = design.cell.at(np.zeros(3))
    turned.rotation = pin.exp3(np.array([0.2, 0, 0])) @ turned.rotation
    with pytest.raises(rp.InputError, match="only .* vary in it, and the target deviates"):
        F(turned)
    within, beyond = (design.cell.at(np.array([0.0, y, 0.0])) for y in (0.5, 1.5))
    for targets, says in (([beyond], "the target"), ([within, beyond], "target 1")):
        with pytest.raises(rp.InputError, match=f"^{says} lies outside the cell: y"):
            F.batch(targets)
    turned.translation = design.cell.at(np.array([0.0, 1.5, 0.0])).translation
    with pytest.raises(rp.InputError, match=r"y is \+0.15 m from the middle"):
        F(turned)  # both wrong: what the cell can be widened for is not all
    with pytest.raises(rp.InputError, match="target"):
        F(np.zeros(3))
    with pytest.raises(rp.InputError, match="leaf"):
        F(design.cell.at(np.zeros(3)), leaf=[1, 2])
    with pytest.raises(rp.InputError, match="both for one task"):
        rp.nearest_inverse_function(rp.Pseudoinverse(panda("position")), design.cell)
    with pytest.raises(rp.InputError, match="incomplete"):
        rp.nearest_inverse_function(rp.Pseudoinverse(panda()), design.cell, incomplete="yes")  # type: ignore[arg-type]


def broken_rotations(R: np.ndarray) -> list[np.ndarray]:
    sheared = R.copy()
    sheared[0, 0] += 1e-5
    return [
        np.diag([1.0, 1.0, -1.0]),
        R @ np.diag([1.0, 1.0, -1.0]),
        np.ones((3, 3)),
        2 * R,
        -R,
        0 * R,
        sheared,
    ]


@pytest.mark.parametrize("kind", ["pose", "axis"])
def test_what_is_not_a_rotation_is_refused(kind: str, tmp_path: Path) -> None:
    """By cells, F, the step of the control, and files; one off by rounding of a file is taken."""
    task, design = panda(kind), found()
    x = task.placement(Q_PANDA)
    controls = [rp.ExtendedJacobian(task, Q_PANDA), design.inverse][: 1 + (kind == "pose")]
    for R in broken_rotations(x.rotation):
        wrong = pin.SE3(R, x.translation)
        with pytest.raises(rp.InputError, match="is not a rotation matrix"):
            rp.Cell(task, wrong, 0.1)
        with pytest.raises(
            rp.InputError, match="the rotation of the target is not a rotation matrix"
        ):
            task.error(Q_PANDA, wrong)
        for control in controls:
            with pytest.raises(
                rp.InputError, match="the rotation of the target is not a rotation matrix"
            ):
                control.step(Q_PANDA, wrong, 0.01)
        if kind == "pose":
            within = pin.SE3(R, design.cell.placement.translation)
            with pytest.raises(
                rp.InputError, match="the rotation of the target is not a rotation matrix"
            ):
                design.function(within)
            with pytest.raises(
                rp.InputError, match="the rotation of target 1 is not a rotation matrix"
            ):
                design.function.batch([design.cell.placement, within])
    rounded = pin.SE3(np.round(x.rotation, 7), x.translation)
    assert np.allclose(
        controls[0].step(Q_PANDA, rounded, 0.01), controls[0].step(Q_PANDA, x, 0.01), atol=1e-6
    )
    with pytest.raises(rp.InputError, match="finite"):
        controls[0].step(Q_PANDA, pin.SE3(np.full((3, 3), np.nan), x.translation), 0.01)


def test_the_control_of_a_cell_knows_its_cell_and_the_limits(tmp_path: Path) -> None:
    """Outside the cell, and where the next joints would be beyond a limit: refused or warned of,
    where asked for."""
    design = found()
    inverse, cell, task = design.inverse, design.cell, design.task
    assert inverse.region is cell
    q, beyond = (design.function(cell.at(np.zeros(3))), cell.at(np.array([1.2, 0.0, 0.0])))
    far = rp.solve_ik(task, q, beyond)
    for how in (inverse, pickle.loads(pickle.dumps(inverse)), in_numpy(inverse)):
        inside = how.step(q, cell.at(np.array([0.02, 0.0, 0.0])), 0.01, outside="raise")
        assert np.abs(inside - q).max() < 0.1
        with pytest.raises(
            rp.InputError, match=r"outside Ω \(scaled distance 1\.2; the boundary is at 1\)"
        ):
            how.step(far, beyond, 0.01, outside="raise")
    corner = corner_beyond_a_limit(tmp_path)
    control, start = corner.inverse, corner(corner.cell.placement)
    path = [start]
    for s in np.linspace(0, 1, 21)[1:]:
        path.append(control.step(path[-1], corner.cell.at(s * np.ones(2)), 0.01, leaf=np.zeros(1)))
    assert corner.task.limit_margin(np.array(path)).min() < -0.01
    first = int(np.argmax(corner.task.limit_margin(np.array(path)).min(axis=1) < -1e-9))
    target = corner.cell.at(np.linspace(0, 1, 21)[first] * np.ones(2))
    with pytest.raises(rp.InputError, match=r"the next q: theta3 = .* is outside its limits"):
        control.step(path[first - 1], target, 0.01, leaf=np.zeros(1), outside="raise")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        control.step(path[first - 1], target, 0.01, leaf=np.zeros(1), outside="warn")
        control.velocity(path[first], np.zeros(2), outside="warn")
    assert ["outside its limits" in str(one.message) for one in told] == [True, True]


def corner_beyond_a_limit(folder: Path) -> rp.InverseFunction:
    """A function over a cell in one corner of which the third joint is beyond its limit."""
    task, q = planar_task([1.0, 0.9, 0.8], folder), [0.6, -1.2, 1.4]
    cell = rp.Cell(task, task.placement(q), 0.35)
    small = {"posture": q, "degree": 2, "options": rp.FitOptions(samples=64, held_out=128)}
    free = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, **small)
    edge = float(free.function(cell.at(np.ones(2)))[2])
    bound = 0.5 * (edge + 1.4)
    limit = f'upper="{bound}"' if edge > 1.4 else f'lower="{bound}"'
    text = (folder / "planar3.urdf").read_text().split('name="theta3"')
    text[1] = re.sub(limit[:5] + r'="[^"]*"', limit, text[1], count=1)
    (folder / "bound.urdf").write_text('name="theta3"'.join(text))
    bound_task = rp.Robot.load(folder / "bound.urdf").task("tool", "xy")
    bound_cell = rp.Cell(bound_task, cell.placement, 0.35)
    return rp.InverseFunction(replace(free.function.chart, cell=bound_cell))


# ---- files
# -------------------------------------------------------------------------------------------


def test_saved_and_loaded_it_gives_the_same_bits(tmp_path: Path) -> None:
    design = found(0.25)
    file = rp.save(design, tmp_path / "cell.json")
    again = rp.load(file, panda())
    assert isinstance(again, rp.CellDesign)
    x = design.cell.at(np.array([0.1, 0.7, -0.3, 0.2, -0.9, 0.4]))
    assert (again.function(x) == design.function(x)).all()
    assert (
        again.summary() == design.summary()
        and rp.save(again, tmp_path / "b.json").read_bytes() == file.read_bytes()
    )
    touching = replace(
        design, evaluation=replace(design.evaluation, limit_margin=0.1, limit_margin_worst=0.0)
    )
    assert rp.load(rp.save(touching, tmp_path / "c.json"), panda()).limit_margin_worst == 0.0
    with pytest.raises(rp.InputError, match="is for the task kind 'pose'"):
        rp.load(file, panda("axis"))
    file.write_text(file.read_text().replace('"degree": ', '"degree":  1'))
    with pytest.raises(rp.InputError, match="checksum"):
        rp.load(file, panda())


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"degrees": []}, "must name at least one polynomial degree"),
        ({"degree": -1}, "the degree of a cell's polynomials must be a whole number from 0 up"),
        ({"degree": 10**9}, "can be at most 64"),
        ({"placement": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "is not a rotation matrix"),
        (
            {"widths": [1e-300, 0.1, 0.1, 0, 0, 0]},
            "half_width must be 0, which holds the coordinate",
        ),
    ],
)
def test_files_that_describe_no_cell_are_refused(changes: dict, says: str, tmp_path: Path) -> None:
    file = rp.save(found(), tmp_path / "cell.json")
    content = json.loads(file.read_text()) | changes
    content["checksum"] = checksum(content)
    file.write_text(json.dumps(content))
    with pytest.raises(rp.InputError, match=says):
        rp.load(file, panda())


def test_a_file_without_the_worst_task_direction_is_read(tmp_path: Path) -> None:
    file = rp.save(found(), tmp_path / "cell.json")
    content = json.loads(file.read_text())
    del content["figures"]["extra_speed_direction"]
    content["checksum"] = checksum(content)
    file.write_text(json.dumps(content))
    again = rp.load(file, panda())
    assert isinstance(again, rp.CellDesign) and "single task direction" not in again.summary()
    assert rp.load(rp.save(again, tmp_path / "b.json"), panda()).summary() == again.summary()
