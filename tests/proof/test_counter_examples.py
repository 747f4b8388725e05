"""Closed paths that do not close although J_V is regular around them: no closing radius may
hold one of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import planar_task, spatial_task
from closed_paths import lift, lifted_round
from controls import some
from proofs import design_of, near_null_space, regular_start

import repctl_pin as rp

GEN3 = (0.2848, 0.0118, 0.4208, 0.0128, 0.3143, 0.0, 0.1674)
"""Distances d of the Kinova Gen3, m; its offsets a are 0, and its axes cross at right angles."""


def gen3(folder: Path) -> rp.Task:
    """The Gen3's pose task, from its Denavit–Hartenberg table."""
    rows, rpy, d, last = ['<link name="l0"/>'], f"{np.pi} 0 0", 0.0, len(GEN3)
    for i, length in enumerate(GEN3, 1):
        rows.append(
            f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/>'
            f'<child link="l{i}"/><origin xyz="0 0 {-d}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        )
        d, rpy = length, f"{np.pi / 2} 0 {np.pi if i > 1 else 0}"
    rows.append(
        f'<link name="tool"/><joint name="tip" type="fixed"><parent link="l{last}"/>'
        f'<child link="tool"/><origin xyz="0 0 {-d}" rpy="{np.pi} 0 {np.pi}"/></joint>'
    )
    path = folder / "gen3.urdf"
    path.write_text(f'<?xml version="1.0"?><robot name="gen3">{"".join(rows)}</robot>')
    return rp.Robot.load(path).task("tool", "pose")


def around_the_base(task: rp.Task, q: np.ndarray, turns: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Poses of the tool round the base's vertical axis, of constant orientation: positions
    (C + 1, 1, 3), rotations (C + 1, 1, 3, 3)."""
    pose = task.placement(q)
    a = np.linspace(0, 2 * np.pi * turns, 96 * turns + 1)
    x, y, z = pose.translation
    p = np.stack([x * np.cos(a) - y * np.sin(a), x * np.sin(a) + y * np.cos(a), z + 0 * a], 1)
    return p[:, None], np.tile(pose.rotation, (len(a), 1, 1, 1))


def ring_gap(design: rp.Design, q: np.ndarray, turns: int = 1) -> tuple[float, float, bool]:
    """Follow the ring: how far from closed it is modulo 2π, the largest share of Ω used, and
    whether all of its poses are within the closing radius around the start."""
    p, R = around_the_base(design.task, q, turns)
    try:
        with np.errstate(all="ignore"):
            end, share = lift(design, q[None], p, R, 4)
    except (np.linalg.LinAlgError, rp.InputError):
        # it left all poses that can be reached
        return np.nan, np.inf, False
    away = np.abs(end[0] - q)
    closes = rp.prove(design, margin=0.01, seconds=1).closes
    poses = np.tile(np.eye(4), (len(p), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = p[:, 0], R[:, 0]
    inside = bool(closes) and all(closes.contains(pose) for pose in poses)
    return float(away.max()), share, inside


RINGS = {
    "planar, r = 1": (lambda _: rp.Robot.load("planar3r").task("tool", "xy"), [0, 0.7, 0.5]),
    "planar, r = 2": (lambda _: rp.Robot.load("planar4r").task("tool", "xy"), [0, 0.7, 0.5, 0.4]),
    "Gen3": (gen3, [0, 0.6, 0.3, 1.7, 0.2, 0.8, 0]),
}
"""Arms, and where their rings round the base begin."""


@pytest.mark.parametrize("case", some(RINGS, "Gen3"))
def test_a_tube_around_a_ring_that_does_not_close(case: str, tmp_path: Path) -> None:
    """The repeatable motion stays in the tube, does not close, and gets no radius."""
    make, start = RINGS[case]
    task, q = make(tmp_path), np.array(start, float)
    x, y, _ = task.placement(q).translation
    path = rp.circle(task, q, float(np.hypot(x, y)), start_angle=float(np.arctan2(y, x)))
    ways = rp.follow(rp.Pseudoinverse(task), path, q, cycles=1, steps=200).q
    options = rp.FitOptions(samples=1024, held_out=64)
    tube = rp.Tube(ways, 0.25)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, tube, degree=2, options=options)
    closes = rp.prove(design, margin=0.01, closes=path, seconds=1).closes
    motion = rp.follow(design.inverse, path, q, cycles=1, steps=400).q
    gap = np.abs(motion[-1] - motion[0])
    assert tube.ratio(motion).max() < 1 and np.sort(gap)[-2] > 0.1  # beside the turn of joint 1
    assert not closes and "does not close" in closes.reason


@pytest.mark.slow
def test_a_ring_in_a_wide_box() -> None:
    """J_V is proved to be regular, the ring's motion stays in Ω, and it does not close."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    box = rp.Box((0, 1.26, 0.385), (3.4, 0.55, 0.75))
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=3)
    gap, share, inside = ring_gap(design, np.array([-3.1, 0.9, 0.9]))
    assert gap > 0.5 and share < 1 and not inside
    assert rp.prove(design, margin=0.3, closes=False)


def wide_design(seed: int, folder: Path) -> tuple[rp.Design, int] | None:
    """A design over a wide box, and how often its ring turns round the base (0: it has none); None
    if there is no regular one."""
    rng, kind = np.random.default_rng(seed), seed % 4
    if kind == 0:  # rings, and double ones
        a, b = rng.uniform(0.6, 1.6), rng.uniform(0.3, 1.2)
        wide = rng.uniform((3.2, 0.2, 0.2), (3.6, 0.55, 0.7))
        task, box = (rp.Robot.load("planar3r").task("tool", "xy"), rp.Box((0, a, b), wide))
        options = rp.FitOptions(samples=128, held_out=64)
        degree = int(rng.integers(1, 4))
        try:
            design = rp.nearest_repeatable(
                rp.Pseudoinverse(task), None, box, degree=degree, options=options
            )
        except rp.RepctlError:
            return None
        return design, int(rng.integers(1, 3))
    if kind == 1:  # r = 2, round the base
        task = planar_task(rng.uniform(0.2, 0.6, 4).tolist(), folder)
    elif kind == 2:  # arms that change their posture without a singularity, as cuspidal ones do
        task = spatial_task(4, folder, kind="position", seed=seed)
    else:  # r = 2
        task = spatial_task(8, folder, kind="pose", seed=seed)
    q = regular_start(task, seed)
    width = rng.uniform(0.3, 1.2)
    potentials = near_null_space(task, q, width, seed, rough=0.3)
    return design_of(task, potentials, rp.Box(q, width)), int(kind == 1)


def judged(seed: int, folder: Path) -> str:
    """Look for a closed path inside a closing radius that does not close: "sound", or "no radius",
    or "no design"; fails if there is one."""
    made = wide_design(seed, folder)
    if made is None:
        return "no design"
    design, turns = made
    closes = rp.prove(design, margin=0.01, seconds=1).closes
    if turns:
        q = design.region.center
        gap, share, inside = ring_gap(design, q, turns)
        if share < 1 and gap > 1e-6:
            assert not inside, seed
    if not closes:
        return "no radius"
    rng = np.random.default_rng(seed)
    before, after, share = lifted_round(design, closes, 6, rng, paths=12, step=0.3)
    assert np.abs(before - after).max() < 1e-9 and share < 1, seed
    return "sound"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_own_counter_examples(tmp_path: Path) -> None:
    said = [judged(seed, tmp_path) for seed in range(40)]
    assert said.count("sound") > 15
