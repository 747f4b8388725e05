"""Functions over sectors of six arms, at length: all the way round at many poses. All slow."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from cell_functions import tour

import repctl_pin as rp

pytestmark = pytest.mark.slow
_BENCHMARK = Path(__file__).parents[1] / "benchmarks" / "repeatability"
_POSES, _ONE_BY_ONE, _QUADRATURE = 100_000, 2_000, 16_384


@dataclass(frozen=True)
class Case:
    """An arm, the middle of its sector, and the joints of the symmetries that are due."""

    start: tuple[float, ...] | None
    middle: tuple[float, float, float] | None
    sector: dict[str, Any]
    joints: list[int]


TILTED = {"radius": 0.08, "height": 0.08, "half_angle": 0.2, "spin": 0.3, "angle": "all"}
CASES = {
    "panda": Case(None, (0.525, 0.0, 0.25), TILTED, [0, 6]),
    "iiwa14": Case((0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0), None, TILTED, [0, 6]),
    "gen3": Case((0.0, 0.5, np.pi, -1.9, 0.0, 0.9, np.pi / 2), None, TILTED, [0, 6]),
    "xarm7": Case((0.0, 0.2, 0.0, 1.0, 0.0, 0.8, 0.0), None, TILTED, [0, 6]),
    "rail": Case((0.0, 0.1, 0.5, 0.9, 0.1, 0.4, 0.1), None, TILTED | {"angle": 0.2}, [6]),
    "baxter": Case((0.1, -0.5, 0.2, 1.2, -0.3, 0.9, 0.1), None, TILTED | {"angle": 0.1}, [6]),
}


def rail_urdf(folder: Path) -> Path:
    """Write six joints of an arm on a rail along y; the first of them is vertical."""
    axes = ["0 1 0", "0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
    at = ["0 0 0", "0 0 0.3", "0 0 0.1", "0 0 0.4", "0.1 0 0.05", "0.3 0 0", "0.1 0 0"]
    links, joints = ['<link name="base"/>'], []
    for i, (axis, xyz) in enumerate(zip(axes, at, strict=True)):
        parent, kind = f"link{i - 1}" if i else "base", "revolute" if i else "prismatic"
        links.append(f'<link name="link{i}"/>')
        joints.append(
            f'<joint name="q{i}" type="{kind}"><parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            '<limit lower="-2.9" upper="2.9" effort="1" velocity="1"/></joint>'
        )
    joints.append(
        '<joint name="tip" type="fixed"><parent link="link6"/><child link="tool"/>'
        '<origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/></joint>'
    )
    path = folder / "rail.urdf"
    parts = ("".join(links), '<link name="tool"/>', "".join(joints))
    path.write_text(f'<robot name="rail">{"".join(parts)}</robot>', encoding="utf-8")
    return path


def task_of(name: str, folder: Path) -> rp.Task:
    if name == "rail":
        return rp.Robot.load(rail_urdf(folder)).task("tool", "pose")
    if name in ("iiwa14", "gen3"):
        pytest.importorskip("ssik")
    sys.path.insert(0, str(_BENCHMARK))
    try:
        import robots
    finally:
        sys.path.remove(str(_BENCHMARK))
    return robots.task_of(name, folder)


@pytest.mark.parametrize("name", CASES)
def test_all_the_way_round(name: str, tmp_path: Path, capsys) -> None:
    case = CASES[name]
    task = task_of(name, tmp_path)
    start = np.array(case.start) if case.start else task.reference
    middle = task.placement(start)
    if case.middle is not None:
        middle = pin.SE3(middle.rotation, np.array(case.middle))
    given = dict(case.sector)
    if name == "gen3":  # its first axis is 7e-6 rad from the vertical
        given["axis"] = [task.joint_origins(start)[0], task.axes(start)[0]]
    sector = rp.Sector(task, middle, **given)
    assert [one.joint for one in sector.symmetries] == case.joints
    options = rp.FitOptions(samples=256, held_out=512)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        sector,
        posture=rp.solve_ik(task, start, middle),
        degree=2,
        incomplete="shrink",
        options=options,
    )
    with capsys.disabled():
        turns = [f"{np.degrees(turn.reach):.0f}°" for turn in design.evaluation.turns]
        print(f"\n{name}: {design.cell.size()}; {design.extra_speed:.2%}; {turns}")
    F, cell, rng, worst = design.function, design.cell, np.random.default_rng(1), 0.0
    for _ in range(_POSES // 10_000):
        U = rng.uniform(-1, 1, (10_000, cell.k))
        Q = F.batch(U)
        p, R = cell.placements(U)
        targets = [pin.SE3(*pair) for pair in zip(R, p, strict=True)]
        worst = max(worst, np.abs(task.errors(Q, targets)).max())
        ahead = U + 1e-4 * rng.uniform(-1, 1, U.shape)
        inside = np.clip(ahead, -1 + 1e-9, 1 - 1e-9)  # ±1 may be one pose: half a turn
        step = np.abs(F.batch(inside) - Q).max()
        assert step < 0.02  # no jump
    assert worst < 1e-10
    for k in rng.permutation(len(U))[:_ONE_BY_ONE]:  # the same, whatever came before
        assert np.abs(F(targets[k]) - Q[k]).max() < 1e-10
    for one in F.chart.cell.removed:
        i = list(cell.moved).index(one.coordinate)
        V = U.copy()
        V[:, i] = rng.uniform(-1, 1, len(U))
        due = Q.copy()
        due[:, one.joint] += one.sign * cell.widths[one.coordinate] * (V[:, i] - U[:, i])
        assert np.abs(F.batch(V) - due).max() < 1e-14
    path = tour(cell)
    motion = rp.follow(
        design.inverse, path, F(path.placement(0.0)), cycles=3, steps=400, integrator=rp.LeafLock(4)
    )
    with capsys.disabled():
        print(f"{name}: task error {worst:.1e}, drift {motion.drift[-1]:.1e}")
    assert motion.drift.max() < 1e-10


REDUCED = {
    "one orientation": ({}, 0.005),
    "turned": ({"half_angle": (0.4, 0.4, 0.4)}, 0.0065),
    "spin": ({"half_angle": 0.4, "spin": "all"}, 0.009),
}


@pytest.mark.parametrize("name", REDUCED)
def test_extra_joint_speed_by_a_quadrature_over_all_coordinates(name: str, capsys) -> None:
    """∂F/∂x by differences of F, the poses from all coordinates of the sector, no symmetry used."""
    sector, most = REDUCED[name]
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    middle = pin.SE3(task.placement(task.reference).rotation, np.array([0.525, 0, 0.25]))
    cell = rp.Sector(task, middle, radius=0.175, height=0.2, angle="all", **sector)
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, incomplete="keep")
    F, k, h = design.function, design.cell.k, 1e-5
    U = (1 - h) * np.random.default_rng(3).uniform(-1, 1, (_QUADRATURE, k))
    steps = h * np.concatenate([np.eye(k), -np.eye(k)])
    ends = F.batch((U[:, None] + steps).reshape(-1, k), missing="nan")
    Q, ends = F.batch(U, missing="nan"), ends.reshape(len(U), 2, k, task.n)
    good = np.isfinite(Q).all(axis=1) & np.isfinite(ends).all(axis=(1, 2, 3))
    own, least = [], []
    for q, (ahead, behind) in zip(Q[good], ends[good], strict=True):
        J = task.jacobian(q)
        dF = (ahead - behind).T / (2 * h)  # (n, k)
        V, R = np.linalg.qr(J @ dF)  # V: task velocities along the cell, orthonormal
        own.append((np.linalg.solve(R.T, dF.T) ** 2).sum())
        least.append(((np.linalg.pinv(J) @ V) ** 2).sum())
    own, least = np.array(own), np.array(least)
    ratio = own.mean() / least.mean()
    error = (own - ratio * least).std() / least.mean() / np.sqrt(len(own)) / 2
    extra = np.sqrt(ratio) - 1
    with capsys.disabled():
        print(
            f"\n{name}: {extra:.3%} ± {error:.3%} over {k} coordinates at {good.mean():.2%} of "
            f"the poses; reported {design.extra_speed:.3%} ± "
            f"{design.evaluation.extra_speed_error:.3%}, coverage {design.coverage:.2%}, angle "
            f"{design.evaluation.turns[0]}"
        )
    spread = np.hypot(error, design.evaluation.extra_speed_error)
    assert abs(extra - design.extra_speed) < 4 * spread + 2e-4
    assert extra < most + 2 * error
    assert np.all(own > (1 - 1e-6) * least)  # no inverse needs less than J⁺
