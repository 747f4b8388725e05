"""Sectors: cylindrical coordinates, and functions that keep the symmetries of the arm exactly."""

from __future__ import annotations

import json
import pickle
import re
from dataclasses import replace
from html import unescape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA, planar_task, planar_urdf, spatial_urdf, upright_urdf
from cell_functions import f_in_numpy, panda, tour
from commands import main, without_pictures
from controls import evaluate_cells_quickly, in_numpy, some
from design_file import checksum
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from page_file import read
from sectors import WIDTHS, found, sector_of

import repctl_pin as rp

# ---- coordinates ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WIDTHS)
def test_coordinates_placements_and_their_velocities(name: str) -> None:
    sector = sector_of(name)
    for cell in (sector, sector.without(sector.symmetries)):
        U = cell.sample(8)
        p, R = cell.placements(U)
        back, off = cell.coordinates(p, R)
        assert np.allclose(back, U) and np.allclose(off, 0)
        E, h = cell.twists(U, R), 1e-6
        for k in range(cell.k):
            step = h * np.eye(cell.k)[k]
            ahead = cell.errors(*cell.placements(U + step), p, R)
            assert np.allclose(ahead / h, E[:, :, k], atol=1e-5)
        _, slopes = cell.slopes(p, R)
        assert np.allclose(slopes @ E, np.eye(E.shape[2]), atol=1e-9)


def test_the_placement_in_cylindrical_coordinates_by_hand() -> None:
    sector = rp.Sector(
        panda(),
        pin.SE3(pin.exp3(np.array([np.pi, 0, 0])), np.array([0.3, 0.4, 0.2])),
        radius=0.1,
        height=0.2,
        angle=1.0,
        half_angle=(0.3, 0.4),
        spin=0.5,
    )
    x = sector.at([1.0, 1.0, 0.5, 1.0, 0.0, 1.0])
    turn, tilt, spin = (pin.exp3(np.array(v)) for v in ([0, 0, 1.0], [0.3, 0, 0], [0, 0, 0.5]))
    assert np.allclose(x.translation, turn @ [0.36, 0.48, 0.3])
    assert np.allclose(x.rotation, turn @ sector.placement.rotation @ tilt @ spin)


@pytest.mark.parametrize("kind", ["pose", "axis"])
def test_a_tool_that_points_the_opposite_way_is_tilted_by_half_a_turn(kind: str) -> None:
    """About its own x axis, where every axis would do; other rows of a batch do not change."""
    given = {"radius": 0.1, "angle": 1.0, "half_angle": (0.3, 0.4)}
    middle = pin.SE3(pin.exp3(np.array([0, 0, 0.5])), np.array([0.3, 0.4, 0.2]))
    sector = rp.Sector(panda(kind), middle, **given | {"spin": 0.5 * (kind == "pose")})
    turns = [np.diag([1.0, -1, -1]), np.eye(3), pin.exp3(np.array([-0.3, 0.4, 0]))]
    R = middle.rotation @ turns @ pin.exp3(np.array([0, 0, 0.2]))
    U, off = sector.coordinates(np.tile(middle.translation, (3, 1)), R)
    due = [[0, 0, np.pi, 0, 0.2], [0, 0, 0, 0, 0.2], [0, 0, -0.3, 0.4, 0.2]]
    widths = sector.widths[sector.widths > 0]
    assert np.allclose(U * widths, np.array(due)[:, : len(widths)], rtol=0, atol=1e-12)
    assert np.allclose(off, 0)


def test_the_middle_of_a_sector_in_its_coordinates() -> None:
    """Radius and height from the base's vertical axis, or from the point that is given."""
    for axis, due in ((None, (0.5, 0.35)), ([[0.3, 0, 0.1], [0, 0, 2]], (0.4, 0.25))):
        x = pin.SE3(panda().placement(Q_PANDA).rotation, np.array([0.3, 0.4, 0.35]))
        sector = rp.Sector(panda(), x, radius=0.1, angle=0.3, axis=axis)
        point, direction = (0, 0, 0) if axis is None else axis[0], (0, 0, 1)
        assert np.allclose(sector.axis, [point, direction])
        assert np.allclose(sector.centre, [due[0], 0, due[1], 0, 0, 0])
    for name in WIDTHS:
        sector = sector_of(name)
        assert sector.at(np.zeros(sector.k)).isApprox(sector.placement, 1e-12)


@pytest.mark.parametrize("name", ["pose", "one orientation", "axis", "another axis"])
def test_a_sector_is_moved_along_its_angle_and_its_spin(name: str) -> None:
    """Around its own axis; if the tool tilts, the spin gets another middle instead."""
    sector = sector_of(name)
    moves = {1: 0.3} | ({5: -0.2} if sector.task.m == 6 else {})
    moved = sector.turned(moves, dict.fromkeys(moves, 0.4))
    point, direction = sector.axis
    turn, x = pin.exp3(0.3 * direction), sector.placement
    spin = -0.2 if len(moves) == 2 and not sector.tilted else 0.0
    due = turn @ x.rotation @ pin.exp3(np.array([0, 0, spin]))
    place = point + turn @ (x.translation - point)
    assert moved.placement.isApprox(pin.SE3(due, place), 1e-12)
    assert moved.spin_middle == (-0.2 if name == "pose" else 0.0)
    widths = [0.4 if i in moves else w for i, w in enumerate(sector.widths)]
    assert np.array_equal(moved.widths, widths)


def test_symmetries_are_found_from_the_task(tmp_path: Path) -> None:
    both = sector_of("pose").symmetries
    assert [(one.coordinate, one.joint, one.sign) for one in both] == [(1, 0, 1), (5, 6, 1)]
    assert sector_of("another axis").symmetries == ()
    assert [one.coordinate for one in sector_of("a turn without its symmetry").symmetries] == [1]
    upside_down = sector_of("position", axis=[[0, 0, 0], [0, 0, -1]])
    assert [(one.joint, one.sign) for one in upside_down.symmetries] == [(0, -1)]
    off_axis = rp.Robot.load("panda").task("panda_leftfinger", "pose")
    x = off_axis.placement(off_axis.reference)
    ordinary = rp.Sector(off_axis, x, radius=0.05, angle=0.2, spin=0.3)
    assert [one.coordinate for one in ordinary.symmetries] == [1]
    with pytest.raises(rp.InputError, match="turns the tool .*; give it in rad$"):
        rp.Sector(off_axis, x, radius=0.05, angle=0.2, spin="all")
    for one in both:  # the law itself, at configurations of its own
        task, rng = panda(), np.random.default_rng(5)
        q, s = rng.uniform(-1, 1, 7), 0.4
        before = task.placement(q)
        after = task.placement(q + s * np.eye(7)[one.joint])
        turn = pin.exp3(np.array([0, 0, s]))
        round_about = (turn @ before.translation, turn @ before.rotation)
        spun = (before.translation, before.rotation @ turn)
        p, R = round_about if one.coordinate == 1 else spun
        assert np.allclose(after.translation, p) and np.allclose(after.rotation, R)


@pytest.mark.parametrize(("kind", "count"), [("position", 1), ("axis", 0), ("pose", 0)])
def test_a_tool_that_keeps_its_direction_does_not_turn_with_the_arm(
    kind: str, count: int, tmp_path: Path
) -> None:
    """A last link undoes the turn of the first joint: the tool's origin still goes round."""
    text = planar_urdf([0.3, 0.25, 0.2, 0.15, 0.1, 0.1, 0.05])
    *arm, tip = text.split('<joint name="tip" type="fixed">')
    back = (
        '<axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="1"/>'
        '<mimic joint="theta1" multiplier="-1"/></joint>'
    )
    tip = tip.replace(
        '<origin xyz="0.05 0 0"/></joint>', '<origin xyz="0.05 0 0" rpy="0 1 0"/>' + back
    )
    tip = tip.replace('<axis xyz="0 0 1"/>', '<axis xyz="SIN 0 COS"/>')
    tip = tip.replace("SIN", str(-np.sin(1.0))).replace("COS", str(np.cos(1.0)))
    (tmp_path / "arm.urdf").write_text('<joint name="tip" type="revolute">'.join([*arm, tip]))
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", kind)
    sector = rp.Sector(task, task.placement(0.3 * np.ones(7)), radius=0.05, angle=0.2)
    assert len(sector.symmetries) == count


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"radius": 0.5}, "radius of ±0.5 m reaches the axis, which is 0.461 m from the placement"),
        ({"angle": 3.5}, "angle of ±3.5 rad is more than a full turn"),
        ({"angle": "half"}, "all"),
        ({"spin": 4.0}, "spin of ±4 rad is more than a full turn"),
        ({"placement": [0, 0, 0.4]}, "placement lies on the axis"),
        ({"radius": 0.0, "height": 0.0}, "needs a radius, height or half_angle above 0"),
        ({"radius": -0.1}, "radius must be 0 m or more"),
        ({"half_angle": -0.1}, "half_angle must be 0 rad or more"),
        ({"half_angle": 3.0}, "half_angle reaches half a turn"),
        ({"half_angle": (0.95 * np.pi, 0)}, "half_angle reaches half a turn"),
        ({"half_angle": (0.1, 0.1, 3.2)}, "half_angle reaches half a turn"),
        ({"radius": (0.1, 0.1)}, "radius must be one number in m, half of the whole width"),
        ({"half_angle": (0.1, 0.1, 0.1), "spin": 0.1}, "mutually exclusive"),
        ({"axis": [0, 0, 1]}, "axis must be a point"),
        ({"axis": [[0, 0, np.nan], [0, 0, 1]]}, "axis must be a point"),
        (
            {"axis": [[0, 0.1, 0], [0, 0, 1]]},
            "'all' requires a joint that turns the whole arm .*: the axis of panda_joint1 is 0.1 m "
            r"away; give it in rad, or choose .* through \(0, 0, 0\) along \(0, 0, 1\)$",
        ),
        (
            {"placement": [0.3, 0.4, 0.4], "radius": 0.5},
            "reaches the axis, which is 0.5 m from the placement; keep it below 0.5$",
        ),
    ],
)
def test_sectors_that_make_no_sense(change: dict, says: str) -> None:
    x = pin.SE3(panda().placement(Q_PANDA).rotation, np.array([0.45, 0.1, 0.35]))
    options = {"placement": x, "radius": 0.1, "height": 0.05} | change
    with pytest.raises(rp.InputError, match=says) as error:
        rp.Sector(panda(), **options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("kind", "change", "says"),
    [
        (
            "position",
            {"spin": 0.2},
            "spin: the position task leaves the rotation about the tool free",
        ),
        ("axis", {"spin": "all"}, "spin: the axis task leaves the rotation about the tool free"),
        ("axis", {"half_angle": (0.1, 0.1, 0.1)}, "half_angle must be .*: x, y"),
        (
            "position",
            {"half_angle": (0.2, 0.0)},
            "half_angle: the position task leaves the rotation free",
        ),
        ("xy", {"height": 0.2}, "height: the xy task does not command the height"),
        ("xz", {}, "axis of a sector for the xz task must be along y"),
    ],
)
def test_coordinates_that_a_task_leaves_free(kind: str, change: dict, says: str) -> None:
    x = panda().placement(Q_PANDA)
    with pytest.raises(rp.InputError, match=says):
        rp.Sector(panda(kind), x, **({"radius": 0.1} | change))


def test_the_axis_of_a_planar_sector_is_across_its_plane(tmp_path: Path) -> None:
    """Either way along it, and as long as it may be; a tilt of a thousandth is refused."""
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    x = task.placement([0.2, 0.8, 0.8])

    def sector(*direction: float) -> rp.Sector:
        return rp.Sector(task, x, radius=0.1, angle=1.0, axis=[[0, 0, 0], direction])

    for z in (1.0, -3.0, 1e-3):
        np.testing.assert_allclose(sector(0, 0, z).axis[1], [0, 0, np.sign(z)])
    for direction in ((1, 0, 0), (1e-3, 0, 1), (0, 1e-3, -1)):
        with pytest.raises(rp.InputError, match="must be along z, normal to its plane"):
            sector(*direction)
    with pytest.raises(rp.InputError, match="axis must be a point, m, and a direction"):
        sector(0, 0, 0)


# ---- functions -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", some(WIDTHS, "pose"))
def test_f_is_an_inverse_and_exact_across_the_symmetries(name: str) -> None:
    design = found(name)
    F, task, cell = design.function, design.task, design.cell
    U = np.random.default_rng(1).uniform(-0.95, 0.95, (16, cell.k))
    Q = F.batch(U)
    targets = [cell.at(u) for u in U]
    assert np.abs(task.errors(Q, targets)).max() < 1e-10
    assert np.allclose([F(x) for x in targets], Q, atol=1e-11, rtol=0)
    assert np.abs([F.inverse.leaf(q) for q in Q]).max() < 1e-9
    for one in F.chart.cell.removed:
        i = list(cell.moved).index(one.coordinate)
        V = U.copy()
        V[:, i] = -0.3 * V[:, i]
        due = Q.copy()
        due[:, one.joint] += one.sign * cell.widths[one.coordinate] * (V[:, i] - U[:, i])
        assert np.abs(F.batch(V) - due).max() < 4e-15
    lower, upper = F.leaves(targets[0])[0]
    assert lower < -0.02 and upper > 0.02
    c = np.full(task.r, 0.01)
    moved = F(targets[0], leaf=c)
    assert np.abs(task.error(moved, targets[0])).max() < 1e-10
    assert np.allclose(F.inverse.leaf(moved), c)


@pytest.mark.parametrize(
    ("name", "i"), [("pose", 5), pytest.param("position", 1, marks=pytest.mark.slow)]
)
def test_a_symmetric_coordinate_has_ends(name: str, i: int) -> None:
    """One pose at a time and in a batch: at the end of its range, and just outside."""
    F, cell = found(name).function, found(name).cell
    for side in (-1, 1):
        for factor, inside in ((1.0, True), (1.001, False), (1.5, False)):
            u = 0.3 * np.ones(cell.k)
            u[i] = side * factor
            p, R = cell.placements(u[None])
            x = pin.SE3(R[0], p[0])
            if inside:
                assert np.abs(F(x) - F.batch([x])[0]).max() < 1e-11
                continue
            says = f"lies outside the cell: {cell.names[i]} is "
            for evaluate in (lambda x=x: F(x), lambda x=x: F.batch([x])):
                with pytest.raises(rp.InputError, match=says):
                    evaluate()


@pytest.mark.slow
def test_each_coordinate_of_width_0_is_held() -> None:
    """One of them alone is enough to be outside, one pose at a time and in a batch."""
    F = found("one orientation").function
    for turn in 0.01 * np.eye(3):
        x = F.cell.at(np.zeros(F.cell.k))
        x.rotation = x.rotation @ pin.exp3(turn)
        for evaluate in (lambda x=x: F(x), lambda x=x: F.batch([x])):
            with pytest.raises(rp.InputError, match="by 0.01 m or rad in another coord"):
                evaluate()


@pytest.mark.parametrize("name", some(WIDTHS, "pose"))
def test_the_controller_is_the_derivative_of_f(name: str) -> None:
    design = found(name)
    inverse, task = design.inverse, design.task
    rng = np.random.default_rng(2)
    for u in rng.uniform(-0.8, 0.8, (4, design.cell.k)):
        q = design.function(design.cell.at(u)) + 0.1 * rng.normal(size=task.n)
        q[-1] += 0.5  # the spin is outside the sector
        q[design.function.chart.cell.removed[0].joint if name == "pose" else 0] += 2 * np.pi
        V, h = inverse.potentials.gradient(q), 1e-6
        ends = [[inverse.potentials.value(q + w * h * e) for e in np.eye(task.n)] for w in (1, -1)]
        assert np.allclose((np.array(ends[0]) - ends[1]) / (2 * h), V, atol=1e-6)
        xdot = rng.normal(size=task.m)
        assert np.allclose(inverse(q) @ xdot, inverse.velocity(q, xdot), atol=1e-8)
        assert np.allclose(V.T @ inverse(q), 0, atol=1e-9)
    for size in (2e-4, 0.0):  # tilts so small that their formulas are series; none
        q = design.function(design.cell.at(size * rng.uniform(-1, 1, design.cell.k)))
        xdot = rng.normal(size=task.m)
        assert np.allclose(inverse(q) @ xdot, inverse.velocity(q, xdot), atol=1e-9)


@pytest.mark.parametrize("name", some(WIDTHS, "one orientation"))
def test_potentials_of_a_sector_in_c_are_the_potentials(name: str) -> None:
    """On random polynomials, at angles and tilts of all sizes; where the radius depends on the
    height, in and beside the sector: far away, its radial coordinate is large without bounds."""
    chart, rng = found(name).function.chart, np.random.default_rng(0)
    chart = replace(chart, coefficients=rng.normal(size=chart.coefficients.shape))
    inverse, task = rp.InverseFunction(chart).inverse, chart.cell.task
    for _ in range(8):
        q, xdot = rng.uniform(-2, 2, task.n), rng.normal(size=task.m)
        if chart.cell.profile.degree:
            q = found(name).function(chart.cell.at(rng.uniform(-1, 1, chart.cell.k))) + 0.05 * q
        h = inverse.potentials.value(q)
        assert np.allclose(inverse.leaf(q), h, rtol=0, atol=1e-9 * np.abs(h).max())
        try:
            G = inverse(q)
        except rp.SingularityError:
            with pytest.raises(rp.SingularityError):
                inverse.velocity(q, xdot)
        else:
            away = np.abs(inverse.velocity(q, xdot) - G @ xdot).max()
            assert away < 1e-8 * np.abs(G).max()


def speeds_of(design: rp.CellDesign, U: np.ndarray) -> tuple[np.ndarray, ...]:
    """‖G E C‖² of the function and of G_d, and that of their difference, at poses given in all
    coordinates of the sector; nothing here knows of a symmetry."""
    Q = design.function.batch(U)
    R = np.array([design.task.placement(q).rotation for q in Q])
    E = design.cell.twists(U, R) @ design.cell.speeds(U)
    own, wanted = (G.batch(Q) @ E for G in (design.inverse, design.desired))
    return tuple((X**2).sum(axis=(1, 2)) for X in (own, wanted, own - wanted))


@pytest.mark.parametrize("name", some(["pose", "xy"], "pose"))
def test_whole_turns_of_a_symmetric_joint_stay_on_the_leaf(name: str) -> None:
    """By the potentials, and by the steps of the controller."""
    design = found(name)
    inverse, task = design.inverse, design.task
    x = design.cell.at(0.5 * np.ones(design.cell.k))
    q = design.function(x)
    for turns in (-2, 1):
        for one in design.function.chart.cell.removed:
            wound = q + 2 * np.pi * turns * np.eye(task.n)[one.joint]
            assert np.abs(inverse.leaf(wound)).max() < 1e-9
            after = inverse.step(wound, x, 0.01, leaf=np.zeros(task.r), gain=50.0)
            assert np.abs(after - wound).max() < 1e-9


@pytest.mark.parametrize("name", some(["pose", "axis", "one orientation"], "pose"))
def test_the_cost_of_the_reduced_function_is_that_of_the_whole(name: str) -> None:
    """Its held-out poses at any angle and spin: the same figures."""
    design = found(name)
    cell, j = design.cell, design.evaluation
    reduced = design.function.chart.cell
    removed = [list(cell.moved).index(one.coordinate) for one in reduced.removed]
    U = np.random.default_rng(3).uniform(-1, 1, (64, cell.k))
    held_out = reduced.sample(design.held_out, design.seed + 2)
    U[:, np.delete(np.arange(cell.k), removed)] = held_out
    own, wanted, off = speeds_of(design, U)
    assert removed and j.coverage == 1
    assert j.cost == pytest.approx(off.mean(), rel=1e-6)
    extra = np.sqrt(own.mean() / wanted.mean()) - 1
    assert j.extra_speed == pytest.approx(extra, rel=1e-6)
    assert j.extra_speed_worst >= np.sqrt((own / wanted).max()) - 1 - 1e-9


@pytest.mark.slow
def test_how_far_round_the_tool_and_what_ends_it() -> None:
    """The range of the spin is that of the last joint, around a middle that is not the posture's;
    at both ends the joint is inside its limits, a little further it is not."""
    sector = sector_of("one orientation", spin="all", angle=0.3)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(sector.task),
        sector,
        posture=rp.solve_ik(sector.task, Q_PANDA, sector.placement),
        degree=1,
        options=rp.FitOptions(samples=32, held_out=64),
    )
    F, cell, task = design.function, design.cell, design.task
    _, turn = design.evaluation.turns
    i = list(cell.names).index("spin")
    assert turn.coordinate == "spin" and turn.reach == 2 * cell.widths[5]
    turned = pin.log3(sector.placement.rotation.T @ cell.placement.rotation)
    assert np.abs(turned[:2]).max() < 1e-9 and 0.1 < abs(turned[2]) < np.pi
    U = np.random.default_rng(4).uniform(-1, 1, (200, cell.k))
    U[:, i] = np.sign(U[:, i])
    Q = F.batch(U)
    assert np.abs(task.errors(Q, [cell.at(u) for u in U])).max() < 1e-10
    margin = task.limit_margin(Q)[:, 6]
    for side in (-1, 1):
        assert 0 <= margin[U[:, i] == side].min() < 0.1
    reduced = F.chart.cell
    V = reduced.sample(64, 5)
    q_ref, _ = F.chart.reference(V)
    solved = F.chart.solve(V, np.zeros((64, 1)))
    assert np.abs(solved.Q - q_ref).max() < 6e-5  # it is still the function


@pytest.mark.slow
def test_tilts_stay_about_the_axes_that_were_given() -> None:
    """The middle of the spin moves, and the placement stays: moved with it, the tilts would be
    about other axes, and F refused poses of the cell."""
    sector = sector_of("spin as far as the joint goes")
    design = found("spin as far as the joint goes")
    F, cell, task = design.function, design.cell, design.task
    _, turn = design.evaluation.turns
    assert turn.coordinate == "spin" and turn.reach == 2 * cell.widths[5]
    assert cell.placement.isApprox(sector.placement)
    assert abs(cell.spin_middle) > 0.3 and abs(cell.spin_middle) + turn.reach / 2 > 3.15
    U = cell.sample(256, 3)
    p, R = cell.placements(U)
    back, off = cell.coordinates(p, R)
    assert np.allclose(back, U, atol=1e-9) and np.allclose(off, 0)
    x = pin.SE3(R[7], p[7])
    tilted = [*U[7, :5] * cell.widths[:5], U[7, 5] * cell.widths[5] + cell.spin_middle]
    phi, (rho, z) = tilted[1], cell.middle
    outward, _, up = cell.directions
    flat = (rho + tilted[0]) * outward + (z + tilted[2]) * up
    round_about = pin.exp3(phi * up)
    assert np.allclose(x.translation, cell.axis[0] + round_about @ flat)
    tilt, spin = (pin.exp3(np.array(t)) for t in ([*tilted[3:5], 0], [0, 0, tilted[5]]))
    assert np.allclose(x.rotation, round_about @ sector.placement.rotation @ tilt @ spin)
    U[:, 5] = -cell.spin_middle / cell.widths[5]  # the spin of the given placement
    U[128:, 5] = np.sign(U[128:, 5] - 0.5 + np.random.default_rng(1).uniform(size=128))
    Q = F.batch(U)
    assert np.abs(task.errors(Q, [cell.at(u) for u in U])).max() < 1e-10
    assert task.limit_margin(Q).min() >= 0
    middle = F.batch(np.zeros((1, cell.k)))
    assert np.allclose(design.posture, middle[0], atol=1e-12)
    corners = F.batch(cell.corners())  # where links 2 and 5 are nearest
    nearest = rp.Bodies(task).distances(corners).min()
    assert design.evaluation.body_distance == pytest.approx(nearest, abs=1e-9)


def test_a_spin_beyond_half_a_turn_is_the_same_in_every_form() -> None:
    """In C, in NumPy and in control steps."""
    design = found("spin as far as the joint goes")
    F, cell, slow = design.function, design.cell, f_in_numpy(design.function)
    U = np.clip(cell.sample(16, 7), -0.9, 0.9)
    U[:, 5] = 0.99 * np.sign(cell.spin_middle)
    assert abs(cell.spread(U)[0, 5]) > np.pi
    targets, Q = [cell.at(u) for u in U], F.batch(U)
    assert np.abs([F(x) for x in targets] - Q).max() < 1e-9
    for x, q in zip(targets, Q, strict=True):
        for inverse in (F.inverse, in_numpy(F.inverse)):
            assert np.abs(inverse.leaf(q)).max() < 1e-9
            assert np.abs(inverse.step(q, x, 0.01, gain=50.0) - q).max() < 1e-9
    assert np.abs([slow(x) for x in targets] - Q).max() < 1e-9


@pytest.mark.slow
def test_a_range_that_ends_at_the_joints_is_measured_to_half_a_turn() -> None:
    """The angle may go on to half a turn, as far as the joint does; what lies beside the sector in
    another coordinate is named by that. The posture of the design is that of the middle."""
    design = found()
    cell = design.cell
    assert cell.free == (1,) and 2 < cell.widths[1] < 3
    u = np.array([0.0, 2.5 / cell.widths[1], 0.0])
    q = design.function(cell.at(u))
    assert cell.ratio(q[None]) == pytest.approx(2.5 / np.pi)
    beside = cell.at(u + [1.5, 0, 0])
    with pytest.raises(rp.InputError, match=r"radius is \+0.12 m from the middle"):
        cell.coordinates_of(beside)
    for name in ("one orientation", "spin as far as the joint goes"):
        design = found(name)
        x = design.cell.at(np.zeros(design.cell.k))
        assert np.abs(design.task.error(design.posture, x)).max() < 1e-9


def test_how_far_round_and_what_ends_it() -> None:
    design = found("one orientation")
    (turn,) = design.evaluation.turns
    F, cell, task = design.function, design.cell, design.task
    U = np.random.default_rng(4).uniform(-1, 1, (200, cell.k))
    U[:, 1] = 0.0
    spread = np.ptp(F.batch(U)[:, 0])
    assert turn.joint == "panda_joint1" and 0.95 * spread <= turn.spread
    assert np.isclose(turn.reach, turn.joint_range - turn.spread)
    assert turn.reach <= turn.nearly <= turn.most <= turn.joint_range
    assert turn.covered == 1.0 and np.isclose(turn.as_covered, turn.reach, atol=0.01)
    assert np.isclose(cell.widths[1], turn.reach / 2)
    for end in (-1.0, 1.0):  # both ends of the angle are inside the limits, further is not
        U[:, 1] = end
        assert task.limit_margin(F.batch(U))[:, 0].min() > -1e-9
        U[:, 1] = end * np.pi / cell.widths[1] * 0.999
        with pytest.raises(rp.InputError, match="panda_joint1 = .* outside its limits"):
            F.batch(U)
    reach = np.floor(10 * np.degrees(turn.reach)) / 10  # a promise is rounded down
    assert f" {reach:g}° at every covered pose" in design.summary()
    assert "panda_joint1 turns the whole arm about the axis" in design.summary()


@pytest.mark.slow
@pytest.mark.parametrize("tilt", some([0.0, 3.1416 - np.pi, 3.14 - np.pi, 0.01], 0.01))
def test_a_sector_turns_about_the_joints_own_axis(tilt: float, tmp_path: Path) -> None:
    """Issue 20, item 19: where π is rounded in a URDF, the first joint's axis is tilted a little,
    and was not found. F(R_a(φ) x) = F(x) + φ e₁ is exact about that axis, and the tilt is said. An
    axis that differs by more than a rounded π is refused, and named."""
    (tmp_path / "arm.urdf").write_text(upright_urdf(tilt), encoding="utf-8")
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "pose")
    q0 = np.array([0.1, 0.7, 0.2, 1.2, 0.1, 0.8, 0.0])
    size: dict[str, Any] = {"radius": 0.03, "height": 0.03, "angle": "all"}
    if abs(tilt) > 2e-3:
        with pytest.raises(rp.InputError, match="joint1 is tilted by 0.01 rad") as error:
            rp.Sector(task, task.placement(q0), **size)
        numbers = re.findall(r"\(([-\d., e]*)\)", error.value.remedy)
        size["axis"] = [[float(x) for x in row.split(",")] for row in numbers]
    sector = rp.Sector(task, task.placement(q0), **size)
    said = sector.without(sector.symmetries).symmetry()
    near = f"tilted by {abs(tilt):.2g} rad"
    assert (near in said) == (0 < abs(tilt) < 2e-3) and "joint1 turns" in said

    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), sector, posture=q0, degree=1,
        options=rp.FitOptions(samples=32, held_out=64),
    )  # fmt: skip
    again = rp.load(rp.save(design, tmp_path / "cell.json"), task=task).function
    F, cell = design.function, design.cell
    o, a = task.joint_origins(q0)[0], task.axes(q0)[0]
    for u in cell.sample(16, 2):
        x = cell.at(u * [1, 0.5, 1])
        for phi in (0.7, -0.9):
            R = pin.exp3(phi * a)
            turned = pin.SE3(R @ x.rotation, o + R @ (x.translation - o))
            q = F(turned)
            assert np.allclose(q - F(x), phi * np.eye(7)[0], rtol=0, atol=1e-10)
            assert np.allclose(task.error(q, turned), 0, atol=1e-11)
            assert np.allclose(again(turned), q, rtol=0, atol=1e-12)


def test_the_tilt_of_the_last_joint_is_named(tmp_path: Path) -> None:
    """Issue 20, item 19: the tool's z axis is fixed by the frame, so a spin about another axis is
    no symmetry of the coordinates."""
    urdf = upright_urdf().replace(
        '<origin xyz="0 0 0.1"/>', '<origin xyz="0 0 0.1" rpy="3.1416 0 0"/>'
    )
    (tmp_path / "arm.urdf").write_text(urdf, encoding="utf-8")
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "pose")
    middle = task.placement([0.1, 0.7, 0.2, 1.2, 0.1, 0.8, 0.0])
    with pytest.raises(
        rp.InputError, match="the axis of joint7 is tilted by 7.3e-06 rad; give it in"
    ):
        rp.Sector(task, middle, radius=0.03, spin="all")


def bounded(half_width: float, folder: Path, *bounded_joints: int) -> rp.CellDesign:
    """A planar design around 0.8 rad, from which some joints move by ``half_width`` at most."""
    text = planar_urdf([0.5, 0.4, 0.3], range_=3.0).split("<limit ")
    for i in bounded_joints:
        text[i] = (
            text[i]
            .replace('"-3.0"', f'"{0.8 - half_width}"')
            .replace('"3.0"', f'"{0.8 + half_width}"')
        )
    (folder / "bounded.urdf").write_text("<limit ".join(text), encoding="utf-8")
    task, q = rp.Robot.load(folder / "bounded.urdf").task("tool", "xy"), [0.2, 0.8, 0.8]
    return rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Sector(task, task.placement(q), radius=0.2),
        posture=q,
        degree=1,
        incomplete="keep",
        options=rp.FitOptions(samples=32, held_out=64),
    )


@pytest.mark.slow
def test_poses_beyond_other_limits_do_not_end_the_angle(tmp_path: Path) -> None:
    """The spread of θ₁ over the covered radii only, which a fine grid of radii finds, too."""
    design = bounded(0.15, tmp_path, 2)
    (turn,) = design.evaluation.turns
    U = np.linspace(-1, 1, 1001)[:, None] * [1.0, 0.0]
    Q = design.function.batch(U, missing="nan")
    covered = np.isfinite(Q).all(axis=1)
    assert 0.9 < covered.mean() < 0.99
    assert turn.covered == pytest.approx(covered.mean(), abs=2e-3)
    assert turn.spread == pytest.approx(np.ptp(Q[covered, 0]), abs=2e-3)


@pytest.mark.slow
def test_a_sector_without_a_covered_pose_is_refused(tmp_path: Path) -> None:
    """Two joints that hardly move leave only the middle."""
    says = "theta3 is .* rad beyond its limit; no smaller"
    with pytest.raises(rp.NoFunctionError, match=says) as caught:
        bounded(1e-6, tmp_path, 2, 3)
    assert not caught.value.partly and "keep" not in str(caught.value)


@pytest.mark.slow
def test_the_price_of_a_given_angle(tmp_path: Path) -> None:
    """Beside the function that goes as far as the joint does, which here is all round."""
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    q = [0.2, 0.8, 0.8]
    sector = rp.Sector(task, task.placement(q), radius=0.1, angle=3.0)
    options = rp.FitOptions(samples=32, held_out=64)
    how: dict[str, Any] = {"posture": q, "degree": 1, "options": options}
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), sector, **how)
    (turn,) = design.evaluation.turns
    assert turn.unasked == pytest.approx(2 * np.pi) and abs(turn.price) < 1e-6
    assert turn.reach == turn.nearly == turn.most == 2 * np.pi
    assert sector.widths[1] == design.cell.widths[1] == 3.0
    text = str(replace(turn, reach=5.0, nearly=5.2, most=5.5, price=0.004, unasked=4.0))
    assert "5.2" not in text and "\n297.9° at 99.9 %, 315.1° at 99 % of them" in text
    assert "the range asked for costs 0.40 % joint speed; 'all' gives 229.1°" in text
    text = str(replace(turn, reach=5.0, covered=0.9951, as_covered=5.3))
    due = "286.4° at every covered pose, 303.6° at 99.5 % of them, as many as F covers"
    assert text.startswith(due)
    rp.save(design, tmp_path / "cell.json")
    assert rp.load(tmp_path / "cell.json", task).evaluation.turns == (turn,)


def test_what_the_text_of_a_range_says() -> None:
    (turn,) = found("one orientation").evaluation.turns
    assert turn.price == 0 and np.isnan(turn.unasked)
    known = replace(turn, reach=5.0, nearly=5.0, most=5.0, joint_range=5.8, spread=0.8)
    plain = str(known)
    assert plain == (
        "286.4° at every covered pose\n"
        "ended by panda_joint1, which turns 332.3° and differs by 46° over the sector"
    )
    assert str(replace(known, reach=2 * np.pi)) == "360° at every covered pose"
    assert str(replace(known, reach=-0.5)).startswith("0° at every covered pose\n")
    for covered, as_covered, said in (
        (0.9, 5.015, True),
        (0.9, 5.005, False),
        (1.0, 5.3, False),
        (0.0, 5.3, False),
    ):
        text = str(replace(known, covered=covered, as_covered=as_covered))
        assert ("287.3° at 90.0 % of them, as many as F covers of all" in text) is said
        assert said or text == plain
    assert "\n287.3° at 99.9 % of them\n" in str(replace(known, nearly=5.015))
    for price, text in ((0.05, "5.00 %"), (-0.01, "0.00 %")):
        costs = f"\nthe range asked for costs {text} joint speed; 'all' gives 229.1°"
        assert str(replace(known, price=price, unasked=4.0)) == plain + costs


def test_the_ranges_at_most_poses_are_those_of_a_dense_sample() -> None:
    """The share of poses at which the joint is inside its limits, on new poses of the cell; and the
    joint's largest and smallest value, which are at its edges."""
    design = found("one orientation")
    chart, (turn,) = design.function.chart, design.evaluation.turns
    U = np.concatenate([chart.cell.sample(8192, 77), chart.cell.corners()])
    U = np.concatenate([U, np.clip(2 * U, -1, 1)])
    points = chart.solve(U, np.zeros((len(U), 1)))
    joint = points.Q[:, 0]
    assert points.found.all()
    assert turn.spread == pytest.approx(np.ptp(joint), abs=1e-6)
    away = np.abs(joint - (joint.min() + joint.max()) / 2)[:8192]
    for range_, most, least in (
        (turn.nearly, 0.9998, 0.997),
        (turn.most, 0.994, 0.985),
        (turn.as_covered, 1.0, 0.9996),
    ):
        assert least <= (away <= (turn.joint_range - range_) / 2).mean() <= most


def test_the_largest_value_of_a_joint_is_found_by_search() -> None:
    """At edges of a sector with tilts, where its 4096 sampled poses do not come."""
    design = found("pose")
    cell = design.function.chart.cell
    U = np.clip(4 * cell.sample(4096, 5), -1, 1)
    points = design.function.chart.solve(U, np.zeros((len(U), 1)))
    assert points.found.all()
    for one, turn in zip(cell.removed, design.evaluation.turns, strict=True):
        spread = np.ptp(points.Q[:, one.joint])
        assert spread - 1e-6 < turn.spread < spread + 1e-3


@pytest.mark.parametrize("lower", some([-np.inf, -0.1], -0.1))
def test_a_sector_goes_round_as_far_as_its_joint(lower: float, tmp_path: Path) -> None:
    """All round and around the given placement without limits, else up to both limits."""
    text = planar_urdf([0.5, 0.4, 0.3])
    limits = text.replace('"-7.0"', f'"{lower}"', 1).replace('"7.0"', '"0.8"', 1)
    endless = text.replace("revolute", "continuous", 1)
    file = tmp_path / "arm.urdf"
    file.write_text(limits if np.isfinite(lower) else endless, encoding="utf-8")
    task, q = rp.Robot.load(file).task("tool", "xy"), [0.2, 0.8, 0.8]
    sector = rp.Sector(task, task.placement(q), radius=0.05)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        sector,
        posture=q,
        degree=1,
        options=rp.FitOptions(samples=16, held_out=64),
    )
    (turn,), cell = design.evaluation.turns, design.cell
    assert cell.widths[1] == turn.reach / 2 and design.coverage == 1
    if not np.isfinite(lower):
        assert turn.joint_range == np.inf and turn.reach == 2 * np.pi
        assert cell.placement.isApprox(sector.placement)
        return
    assert turn.reach == pytest.approx(0.9 - turn.spread) and 0.5 < turn.reach < 0.9
    radius, angle = np.linspace(-1, 1, 101), np.repeat([-1 + 1e-8, 1 - 1e-8], 101)
    U = np.stack([np.tile(radius, 2), angle], axis=1)
    first = design.function.batch(U)[:, 0]
    assert np.allclose([first.min(), first.max()], [-0.1, 0.8], atol=1e-6)


def test_bodies_are_looked_at_all_round(tmp_path: Path) -> None:
    """A post is in the way of the first link at one end of the angle, which the function's
    coordinates do not contain: the pose that is named is there, and has the distance."""
    text = planar_urdf([0.5, 0.4, 0.3])
    for i, length in enumerate((0.5, 0.4, 0.3), 1):
        box = f'<origin xyz="{length / 2} 0 0"/><geometry><box size="{0.9 * length} 0.02 0.02"/>'
        bodies = f'<link name="link{i}"><collision>{box}</geometry></collision></link>'
        text = text.replace(f'<link name="link{i}"/>', bodies)
    (tmp_path / "arm.urdf").write_text(text)
    q = [0.2, 0.8, 0.8]
    x, y = 0.4 * np.cos(1.1), 0.4 * np.sin(1.1)
    (tmp_path / "post.urdf").write_text(
        f'<robot name="post"><link name="post"><collision><origin xyz="{x} {y} 0"/>'
        '<geometry><box size="0.02 0.02 0.02"/></geometry></collision></link></robot>'
    )
    around = tmp_path / "post.urdf"
    robot = rp.Robot.load(tmp_path / "arm.urdf", surroundings=around)
    task = robot.task("tool", "xy")
    sector = rp.Sector(task, task.placement(q), radius=0.05, angle=1.0)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), sector, posture=q, degree=1,
        options=rp.FitOptions(samples=32, held_out=256),
    )  # fmt: skip
    (stop,) = design.failures
    assert stop.cause == "collision" and 0.7 < stop.u[1] <= 1
    worst = design.function(design.cell.at(stop.u))
    distances = rp.Bodies(task).distances(worst[None])
    assert distances[0] == pytest.approx(design.body_distance, abs=1e-9)
    Q = design.function.batch(sector.sample(1024, 3))
    assert stop.share == pytest.approx((rp.Bodies(task).distances(Q) < 0).mean(), abs=0.06)


@pytest.mark.parametrize("name", ["pose", "position", "one orientation"])
def test_the_margin_of_a_joint_that_turns_a_sector_is_the_least_of_its_range(name: str) -> None:
    cell = found(name).function.chart.cell
    task, shares = cell.task, np.linspace(-1, 1, 21)
    Q = np.random.default_rng(0).uniform(task.lower, task.upper, (8, task.n))
    expected = task.limit_margin(Q)
    for one in cell.removed:
        turns = np.zeros((21, 1, task.n))
        turns[:, 0, one.joint] = shares * cell.widths[one.coordinate]
        around = task.limit_margin(Q + turns)[..., one.joint].min(axis=0)
        everywhere = np.isinf(cell.limit_margin(Q)[..., one.joint])
        assert everywhere.all() == (one.coordinate in cell.free)
        expected[:, one.joint] = np.where(everywhere, np.inf, around)
    assert cell.removed
    np.testing.assert_allclose(cell.limit_margin(Q), expected, atol=1e-12)


@pytest.mark.slow
def test_a_desired_inverse_without_the_symmetry_is_not_reduced(tmp_path: Path) -> None:
    """A weight that is constant in the joints leaves the symmetry; one that changes with the first
    joint does not, at some configurations only."""
    assert [one.coordinate for one in found("pose").function.chart.cell.removed] == [1, 5]
    task, q = planar_task([0.5, 0.4, 0.3], tmp_path), [0.2, 0.8, 0.8]
    sector = rp.Sector(task, task.placement(q), radius=0.05, angle=0.3)
    few = rp.FitOptions(samples=16, held_out=64)
    for weight, removed in (
        (np.diag([2.0, 1.0, 1.0]), [1]),
        (lambda q: np.diag([2 + np.sin(q[0]) * max(0.0, 0.4 - q[1]), 1.0, 1.0]), []),
    ):
        design = rp.nearest_inverse_function(
            rp.WeightedInverse(task, weight), sector, posture=q, degree=1, options=few
        )
        kept = design.function.chart.cell
        assert [one.coordinate for one in kept.removed] == removed


def test_all_round_requires_the_symmetry_of_the_cost() -> None:
    free = sector_of("one orientation")
    with pytest.raises(rp.InputError, match="angle 'all' requires the symmetry .* body_distance="):
        rp.nearest_inverse_function(rp.Pseudoinverse(free.task), free, body_distance=0.02)


@pytest.mark.slow
def test_an_arm_without_the_symmetry_has_the_same_coordinates(tmp_path: Path) -> None:
    """The angle as an ordinary coordinate: the function is no worse than the symmetric one."""
    sector = sector_of("position", angle=0.3, radius=0.05, height=0.05)
    task, desired = sector.task, rp.Pseudoinverse(sector.task)
    q = rp.solve_ik(task, Q_PANDA, sector.placement)
    how: dict[str, Any] = {
        "posture": q,
        "degree": 2,
        "options": rp.FitOptions(samples=128, held_out=64),
    }
    symmetric = rp.nearest_inverse_function(desired, sector, **how)
    shifted = sector_of(
        "position", angle=0.3, radius=0.05, height=0.05, axis=[[0, 0, 0], [0, 1e-6, 1]]
    )
    assert shifted.symmetries == () and symmetric.function.chart.cell.k == 2
    ordinary = rp.nearest_inverse_function(desired, shifted, **how)
    assert ordinary.function.chart.cell.k == 3 and ordinary.evaluation.turns == ()
    U = sector.sample(256, 5)
    costs = [speeds_of(design, U)[2].mean() for design in (symmetric, ordinary)]
    assert np.isclose(costs[0], symmetric.cost, rtol=0.1)
    assert costs[1] < 1.02 * costs[0]


@pytest.mark.slow
def test_a_planar_arm_turns_about_its_base(tmp_path: Path) -> None:
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    x = task.placement([0.2, 0.8, 0.8])
    sector = rp.Sector(task, x, radius=0.1)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        sector,
        posture=[0.2, 0.8, 0.8],
        degree=2,
        options=rp.FitOptions(samples=32, held_out=64),
    )
    assert design.cell.widths[1] == np.pi  # the joint turns 14 rad: all round
    F = design.function
    angles = np.linspace(-np.pi, np.pi, 25)[1:-1]
    q = [F(design.cell.at([0.3, a / np.pi])) for a in angles]
    assert np.allclose(np.diff(q, axis=0), [[np.diff(angles)[0], 0, 0]] * 22, atol=1e-12)
    path = tour(design.cell)
    motion = rp.follow(design.inverse, path, F(path.placement(0.0)), steps=300)
    assert motion.drift[-1] < 1e-5


# ---- wherever a cell is taken --------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    some(
        ["pose", "a turn without its symmetry", "spin as far as the joint goes", "xy"],
        "pose",
        "spin as far as the joint goes",
    ),
)
def test_a_sector_is_saved_and_copied(name: str, tmp_path: Path) -> None:
    design = found(name)
    rp.save(design, tmp_path / "cell.json")
    again = rp.load(tmp_path / "cell.json")
    assert again.summary() == design.summary() and repr(again.cell) == repr(design.cell)
    U = design.cell.sample(8)
    copied = pickle.loads(pickle.dumps(design.function))
    for F in (again.function, copied):
        assert np.array_equal(F.batch(U), design.function.batch(U))


def test_a_file_that_claims_a_symmetry(tmp_path: Path) -> None:
    rp.save(found("pose"), tmp_path / "cell.json")
    content = json.loads((tmp_path / "cell.json").read_text())
    content["sector"]["axis"][0][0] = 0.1
    content["checksum"] = checksum(content)
    (tmp_path / "cell.json").write_text(json.dumps(content))
    with pytest.raises(rp.InputError, match="a symmetry that the arm does not have"):
        rp.load(tmp_path / "cell.json")


@pytest.mark.parametrize("middle", [7.0, -7.0, 0.5])
def test_a_file_whose_spin_has_no_such_middle(middle: float, tmp_path: Path) -> None:
    name = "pose" if middle == 0.5 else "spin as far as the joint goes"
    rp.save(found(name), tmp_path / "cell.json")
    content = json.loads((tmp_path / "cell.json").read_text())
    assert ("spin_middle" in content["sector"]) == (middle != 0.5)
    content["sector"]["spin_middle"] = middle
    content["checksum"] = checksum(content)
    (tmp_path / "cell.json").write_text(json.dumps(content))
    with pytest.raises(rp.InputError, match="the middle of the spin must be from −2π to 2π rad"):
        rp.load(tmp_path / "cell.json")


def test_a_file_from_before_the_spin_had_a_middle(tmp_path: Path) -> None:
    rp.save(found("spin as far as the joint goes"), tmp_path / "cell.json")
    content = json.loads((tmp_path / "cell.json").read_text())
    del content["sector"]["spin_middle"]
    content["checksum"] = checksum(content)
    (tmp_path / "cell.json").write_text(json.dumps(content))
    with pytest.raises(rp.InputError, match="lacks the middle .*; design the cell aga"):
        rp.load(tmp_path / "cell.json")


@pytest.mark.slow
@pytest.mark.parametrize("name", some(["pose", "spin as far as the joint goes"], "pose"))
def test_the_tour_of_a_sector_closes_and_stays_inside(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command follows it: through every coordinate, to 0.9 of its range and no further."""
    design = found(name)
    rp.save(design, tmp_path / "cell.json")
    given = ["follow", str(tmp_path / "cell.json"), "--steps", "400"]
    assert main([*given, "--csv", str(tmp_path / "way.csv")]) == 0
    assert "tour 0 of the cell" in capsys.readouterr().out
    rows = np.loadtxt(tmp_path / "way.csv", delimiter=",", skiprows=1, comments="#")
    Q = rows[:, 2:9]
    U = np.array([design.cell.coordinates_of(design.task.placement(q)) for q in Q])
    np.testing.assert_allclose(np.abs(U).max(axis=0), 0.9, atol=5e-3)
    assert np.abs(Q[0] - Q[-1]).max() < 1e-6
    assert np.abs(design.function.batch(U) - Q).max() < 1e-5


@pytest.mark.parametrize(
    ("name", "change", "size", "where"),
    [
        (
            "pose",
            {},
            "radius ±0.08 m, height ±0.08 m, angle as far as the joints go, "
            "tilted by ±(0.2, 0.3) rad, spin ±0.3 rad",
            ", tilted by (0.2, -0.3) rad, spun by 0.3 rad",
        ),
        (
            "pose",
            {"angle": 1.0, "half_angle": 0.2, "spin": 0.0},
            "radius ±0.08 m, height ±0.08 m, angle ±1 rad, tilted by ±0.2 rad",
            ", tilted by (0.2, -0.2) rad",
        ),
        (
            "axis",
            {"half_angle": (0.2, 0.0)},
            "radius ±0.08 m, height ±0.08 m, angle ±1 rad, tilted by ±(0.2, 0) rad",
            ", tilted by (0.2, 0) rad",
        ),
        (
            "one orientation",
            {"angle": 1.0, "spin": 0.3},
            "radius ±0.08 m, height ±0.08 m, angle ±1 rad, spin ±0.3 rad",
            ", spun by 0.3 rad",
        ),
        (
            "one orientation",
            {"angle": 1.0},
            "radius ±0.08 m, height ±0.08 m, angle ±1 rad, "
            "one orientation, which turns with the angle",
            "",
        ),
        (
            "a turn without its symmetry",
            {"angle": np.pi, "half_angle": (0.1, 0.1, np.pi)},
            "radius ±0.08 m, height ±0.08 m, angle ±3.14 rad, tilted by ±0.1 rad, spin ±3.14 rad",
            ", tilted by (0.1, -0.1) rad, spun by 3.1 rad",
        ),
        ("position", {}, "radius ±0.08 m, height ±0.08 m, angle ±1 rad", ""),
        ("xy", {}, "radius ±0.08 m, angle as far as the joints go", ""),
    ],
)
def test_a_sector_says_its_size_and_where_a_pose_is(
    name: str, change: dict[str, Any], size: str, where: str
) -> None:
    sector = sector_of(name, **change)
    u = np.array([1.0, 0.0, -1.0, 1.0, -1.0, 1.0])[: sector.k]
    place = "({:.3g}, {:.3g}, {:.3g}) m".format(*sector.at(u).translation)
    assert sector.size() == size and sector.where(u) == place + where
    assert repr(sector).startswith(f"<Sector {size} around (0.45, 0.1, 0.35) m")
    assert sector.symmetry() == "not used"


def test_a_sector_says_its_symmetries_and_scales_the_rest() -> None:
    sector = sector_of("pose", angle=1.0)
    assert sector.tilted and not sector_of("one orientation", spin=0.3).tilted
    assert sector_of("axis", half_angle=(0.2, 0.0)).tilted
    assert sector_of("axis", half_angle=(0.0, 0.2)).tilted
    halved = sector.scaled(0.5)
    assert np.allclose(halved.widths, [0.04, 1.0, 0.04, 0.1, 0.15, 0.3])
    assert halved.symmetries == sector.symmetries and halved.axis is sector.axis
    assert sector.without(sector.symmetries).symmetry() == (
        "panda_joint1 turns the whole arm about the axis and panda_joint7 turns the tool "
        "about its z axis: 4 of 6 coordinates remain"
    )
    assert sector_of("another axis").symmetry() == "none"
    x = pin.SE3(sector.placement.rotation, np.array([0.3, -1e-12, 0.2]))
    assert rp.Sector(panda(), x, radius=0.1).where(np.zeros(2)) == "(0.3, 0, 0.2) m"
    with pytest.raises(rp.InputError, match="a sector is not made around poses"):
        rp.Sector.around(panda(), [x])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[rp.CellDesign, Path, Figure]:
    """A sector by the command, its page, and the figure that it draws: an arm whose first axis is
    vertical, and whose other ones point anywhere."""
    folder = tmp_path_factory.mktemp("sector")
    text = re.sub(
        "<origin [^>]*/><axis [^>]*/>", '<axis xyz="0 0 1"/>', spatial_urdf(6, 7), count=1
    )
    text = text.replace('name="spatial"', f'name="spatial_{"with_a_long_name_" * 7}"', 1)
    (folder / "arm.urdf").write_text(text, encoding="utf-8")
    arm = ["cell", str(folder / "arm.urdf"), "--frame", "tool", "--task", "axis"]
    sizes = ["--radius", "0.02", "--height", "0.03", "--half-angle", "0.15"]
    few = ["--start", ",".join(6 * ["0.4"]), "--degree", "1", "--held-out", "64"]
    with pytest.MonkeyPatch.context() as patch:
        figures = without_pictures(patch)
        evaluate_cells_quickly(patch)
        assert main([*arm, "--sector", *sizes, *few, "--out", str(folder)]) == 0
    task = rp.Robot.load(folder / "arm.urdf").task("tool", "axis")
    design = rp.load(folder / "cell.json", task)
    assert isinstance(design, rp.CellDesign)
    return design, folder / "cell.html", figures[0]


@pytest.mark.slow
def test_the_maps_of_a_sector(drawn: tuple[rp.CellDesign, Path, Figure]) -> None:
    """Limit margin and extra joint speed, pose by pose, and the range of the angle: that of the
    joint less what it differs by over the tilts at one radius and height."""
    design, _, figure = drawn
    F, cell, (turn,) = design.function, design.cell, design.evaluation.turns
    maps = [
        mesh.get_array().reshape(33, 33)
        for ax in figure.axes
        for mesh in ax.collections[:1]
        if mesh.get_array() is not None and mesh.get_array().size == 33 * 33
    ]
    rng = np.random.default_rng(0)
    for row, column in ((0, 0), (32, 5), (16, 30)):
        U = rng.uniform(-1, 1, (200, cell.k))
        U[:, 0], U[:, 2] = column / 16 - 1, row / 16 - 1
        U[:, 1] = 0.0
        U[:4, 3:] = [[-1, -1], [-1, 1], [1, -1], [1, 1]]
        U[4, 3:] = 0.0
        Q = F.batch(U)
        range_ = turn.joint_range - np.ptp(Q[:, 0])
        assert maps[2][row, column] == pytest.approx(np.degrees(range_), abs=0.1)
        least = np.delete(design.task.limit_margin(Q[4]), 0).min()
        assert maps[0][row, column] == pytest.approx(least, rel=1e-6)
        own, wanted, _ = speeds_of(design, U[4:5])
        extra = 100 * (np.sqrt(own / wanted) - 1)
        assert maps[1][row, column] == pytest.approx(extra[0], rel=1e-5)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert figure.get_suptitle().count("\n") == 1  # too long for one line
    assert figure._suptitle.get_window_extent().x1 <= figure.bbox.x1
    assert len(maps) == 3


@pytest.mark.slow
def test_the_edges_of_a_sector(drawn: tuple[rp.CellDesign, Path, Figure]) -> None:
    """In the page of the command: every edge, along one coordinate at a time, to all corners."""
    sector, file = drawn[0].cell, drawn[1]
    page = unescape(file.read_text("utf-8"))
    inner = page.partition('srcdoc="')[2].partition('"></iframe>')[0]
    dialog = inner.partition("<dialog")[2].partition("</dialog>")[0]
    names = [f"<dt>{name}</dt>" for name in ("Angle", "Radius", "Symmetry", "The sector")]
    assert all(name in dialog for name in names) and "the whole table" in dialog
    assert "<dt>Spin</dt>" not in dialog  # which this task leaves open
    scene, _, numbers = read(inner)
    edges, way = scene["paths"]
    joints = scene["series"][-len(scene["arms"]) :]  # after the paths
    numbers = numbers[: len(numbers) - sum(rows * columns for rows, columns in joints)]
    p = numbers[len(numbers) - 3 * (edges + way) : len(numbers) - 3 * way]
    p = p.reshape(edges, 3)
    U, _ = sector.coordinates(p, np.tile(sector.placement.rotation, (edges, 1, 1)))
    U = U[:, :3]
    near = 1 - 40 * scene["resolution"]
    assert (np.abs(U[:, [0, 2]]) > near).all() and np.abs(U).max() < 2 - near
    steps = np.diff(U, axis=0)
    assert (np.abs(steps) > 2 * (1 - near)).sum(axis=1).max() == 1
    corners = [tuple(np.rint(u).astype(int)) for u in U if np.abs(u).min() > near]
    traced = {frozenset(ends) for ends in pairwise(corners) if len({*ends}) == 2}
    assert len({*corners}) == 8 and len(traced) == 12
