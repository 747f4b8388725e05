"""A design for another tool on the same body: laws of G, its figures, its certificate, its file."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from controls import some

import repctl_pin as rp

OFFSET = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 1.1), np.array([0.05, -0.03, 0.12]))
FEW = rp.FitOptions(samples=2048, held_out=2048)


def designed(task: rp.Task, q0: np.ndarray, half: float = 0.4) -> rp.Design:
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(q0, half), degree=2, options=FEW
    )


@pytest.fixture(scope="module")
def at_flange(panda: rp.Robot) -> rp.Design:
    return designed(panda.task("panda_link8"), Q_PANDA)


def test_the_jacobian_and_the_inverse_are_those_of_the_moved_point(at_flange: rp.Design) -> None:
    """Closed form: v' = v − [R t]ₓ ω, so J' = A J and G' = G A⁻¹."""
    moved = at_flange.with_tool(OFFSET)
    for q in Q_PANDA + np.random.default_rng(0).uniform(-0.4, 0.4, (20, 7)):
        x = at_flange.task.placement(q)
        A = np.eye(6)
        A[:3, 3:] = -pin.skew(x.rotation @ OFFSET.translation)
        assert np.allclose(moved.task.placement(q).homogeneous, (x * OFFSET).homogeneous)
        assert np.allclose(moved.task.jacobian(q), A @ at_flange.task.jacobian(q), atol=1e-13)
        assert np.allclose(moved.inverse(q) @ A, at_flange.inverse(q), atol=1e-12)
        assert np.allclose(moved.desired(q) @ A, at_flange.desired(q), atol=1e-12)


def test_paths_of_the_tool_close_and_cost_what_a_fresh_design_costs(
    panda: rp.Robot, at_flange: rp.Design
) -> None:
    tcp = panda.task("panda_hand_tcp")
    moved = at_flange.with_tool(at_flange.task.placement(Q_PANDA).actInv(tcp.placement(Q_PANDA)))
    fresh = designed(tcp, Q_PANDA)
    assert abs(moved.cost / fresh.cost - 1) < 0.01
    assert abs(moved.leaf_margin - at_flange.leaf_margin) < 1e-6
    path = rp.circle(moved.task, Q_PANDA, 0.1)
    motion = rp.follow(moved.inverse, path, Q_PANDA, cycles=3)
    assert motion.drift[-1] < 1e-9


def test_the_inverse_moves_bitwise_as_one_of_a_urdf_with_the_tool(
    panda: rp.Robot, at_flange: rp.Design
) -> None:
    """The frame panda_hand_tcp of the file itself, with the same potentials."""
    tcp = panda.task("panda_hand_tcp")
    moved = at_flange.with_tool(at_flange.task.placement(Q_PANDA).actInv(tcp.placement(Q_PANDA)))
    own = rp.RepeatableInverse(tcp, at_flange.inverse.potentials)
    Q = Q_PANDA + np.random.default_rng(1).uniform(-0.4, 0.4, (50, 7))
    assert np.abs(moved.inverse.batch(Q) - own.batch(Q)).max() < 1e-12


@pytest.mark.parametrize(
    "desired",
    [
        lambda task: rp.WeightedInverse(task, "inertia"),
        pytest.param(
            lambda task: rp.WeightedInverse(task, rp.LimitWeight(task)), marks=pytest.mark.slow
        ),
        pytest.param(
            lambda task: rp.CustomInverse(task, lambda q: np.linalg.pinv(task.jacobian(q))),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_other_desired_inverses_move_with_the_tool(panda: rp.Robot, desired: Any) -> None:
    """‖(G_r' − G_d') A‖ is what it was: both move by the same A."""
    task = panda.task("panda_link8")
    few = rp.FitOptions(samples=256, held_out=128)
    design = rp.nearest_repeatable(desired(task), None, rp.Box(Q_PANDA, 0.2), degree=1, options=few)
    moved = design.with_tool(OFFSET)
    q = Q_PANDA + 0.1
    A = moved.task.jacobian(q) @ np.linalg.pinv(task.jacobian(q))
    gap = (moved.inverse(q) - moved.desired(q)) @ A
    assert np.allclose(gap, design.inverse(q) - design.desired(q), atol=1e-10)


@pytest.mark.slow
def test_the_certificate_is_converted_and_holds(at_flange: rp.Design) -> None:
    """Bounds of the converted certificate are below those of a fresh one, or equal."""
    proved = replace(at_flange, proof=rp.prove(at_flange))
    moved = proved.with_tool(OFFSET)
    one, own = proved.proof, moved.proof
    assert one is not None and own is not None and own.closes and one.closes
    fresh = rp.prove(moved)
    assert own.leaf_margin == one.leaf_margin and own.limit_margin == one.limit_margin
    assert own.subject == moved.subject != proved.subject
    Q = Q_PANDA + np.random.default_rng(2).uniform(-0.4, 0.4, (500, 7))
    sigma = np.linalg.svd(moved.task.jacobians(Q), compute_uv=False)[:, -1]
    assert 0.8 * one.sigma_min < own.sigma_min <= sigma.min()
    assert fresh.closes is not None
    assert 0.5 * one.closes.metres < own.closes.metres < fresh.closes.metres
    rng = np.random.default_rng(3)  # poses at the edge of the new ball lie in the old one
    start = moved.task.placement(own.closes.start)
    for _ in range(500):
        way, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        R = pin.exp3(own.closes.radians * axis) @ start.rotation
        x = pin.SE3(R, start.translation + own.closes.metres * way)
        assert one.closes.contains(x * OFFSET.inverse())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        replace(moved, shrunk=1.0)  # the certificate belongs to it


@pytest.mark.slow
def test_at_constant_orientation_no_metre_is_lost(at_flange: rp.Design) -> None:
    proof = rp.prove(at_flange)
    assert proof.closes is not None
    flat = replace(proof, closes=replace(proof.closes, radians=0.0), seal="")
    design = replace(at_flange, proof=flat.sealed(at_flange.subject))
    own = design.with_tool(OFFSET).proof
    assert own is not None and own.closes is not None
    assert own.closes.radians == 0
    assert own.closes.metres == pytest.approx(proof.closes.metres, rel=1e-5)


def test_a_saved_design_of_a_tool_comes_back(
    at_flange: rp.Design, panda: rp.Robot, tmp_path: Path
) -> None:
    moved = at_flange.with_tool(OFFSET)
    file = rp.save(moved, tmp_path / "tool.json")
    for task in (None, panda.task("panda_link8"), moved.task):
        again = rp.load_design(file, task)
        assert np.array_equal(again.inverse(Q_PANDA), moved.inverse(Q_PANDA))
        assert again.task.frame == moved.task.frame
    with pytest.raises(rp.InputError, match="frame"):
        rp.load_design(file, panda.task("panda_hand_tcp"))
    plain = rp.save(at_flange, tmp_path / "flange.json")
    with pytest.raises(rp.InputError, match="is displaced by"):
        rp.load_design(plain, moved.task)


def test_a_file_is_loaded_for_another_link_of_the_body(
    at_flange: rp.Design, panda: rp.Robot, tmp_path: Path
) -> None:
    file = rp.save(at_flange, tmp_path / "flange.json")
    again = rp.load_design(file, frame="panda_hand_tcp")
    assert again.task.frame == "panda_hand_tcp"
    path = rp.circle(again.task, Q_PANDA, 0.05)
    assert rp.follow(again.inverse, path, Q_PANDA, cycles=2).drift[-1] < 1e-9
    with pytest.raises(rp.InputError, match="panda_link6' is not on the body"):
        rp.load_design(file, frame="panda_link6")
    with pytest.raises(rp.InputError, match="no frame"):
        rp.load_design(file, frame="elsewhere")


def test_two_tools_in_a_row_are_one(at_flange: rp.Design) -> None:
    twice = at_flange.with_tool(OFFSET).with_tool(OFFSET)
    once = at_flange.with_tool(OFFSET * OFFSET)
    q = Q_PANDA + 0.1
    assert np.allclose(twice.inverse(q), once.inverse(q), atol=1e-12)
    back = at_flange.with_tool(OFFSET).with_tool(OFFSET.inverse())
    assert np.allclose(back.inverse(q), at_flange.inverse(q), atol=1e-12)


@pytest.mark.parametrize("kind", some(["axis", "position"], "position"))
def test_other_kinds_are_refused_with_the_reason(panda: rp.Robot, kind: Any) -> None:
    task = panda.task(None, kind)
    few = rp.FitOptions(samples=256, held_out=128)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(Q_PANDA, 0.1), degree=1, options=few
    )
    with pytest.raises(rp.InputError, match=f"not {kind}: the self-motion"):
        design.with_tool(OFFSET)


def test_what_is_no_placement_is_refused(at_flange: rp.Design) -> None:
    for wrong in (np.diag([1, 1, -1, 1.0]), np.eye(3), "tool", np.full((4, 4), np.nan)):
        with pytest.raises(rp.InputError):
            at_flange.with_tool(wrong)


def test_a_tool_far_from_its_frame_is_refused(at_flange: rp.Design) -> None:
    """Item 26.23: a tool 1e9 m away was refused with "it moves relative to it"."""
    for away in (1001.0, 1e9):
        with pytest.raises(rp.InputError, match=f"{away:.3g} m from the frame".replace("+", ".")):
            at_flange.with_tool(pin.SE3(np.eye(3), np.array([away, 0, 0])))
    moved = at_flange.with_tool(pin.SE3(np.eye(3), np.array([999.0, 0, 0])))
    assert moved.task.placement(Q_PANDA).translation[0] != 0
