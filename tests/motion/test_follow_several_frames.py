"""The control of several frames: J⁺ drifts, a design closes, C equals NumPy, doors refuse."""

import numpy as np
import pinocchio as pin
import pytest
from page_file import read
from two_armed import Q0 as FLAT
from two_armed import two_armed

import repctl_pin as rp

HANDS = ["l_gripper_tool_frame", "r_gripper_tool_frame"]


def circle(task, q0):
    return rp.circle(task, q0, 0.08)


@pytest.fixture(scope="module")
def hands():
    """PR2's lift and both arms, with positions of both hands: n = 15, m = 9, r = 6."""
    task = rp.Robot.load("pr2").task([HANDS[0], (HANDS[1], "position")])
    q0 = task.reference + 0.3 * np.random.default_rng(5).normal(size=task.n)
    lower, upper = task.lower, task.upper
    q0 = np.clip(q0, np.maximum(lower, -9) + 0.3, np.minimum(upper, 9) - 0.3)
    q0[~task.revolute] = 0.15
    return task, q0


@pytest.fixture(scope="module")
def constant(hands):
    """The inverse with constant rows V = N(q0)."""
    task, q0 = hands
    rows = np.linalg.svd(task.jacobian(q0))[2][task.m :]
    basis = rp.Polynomial(q0, 1)
    slopes = basis.gradients(q0[None])[0]  # (n, number of potentials)
    A = np.linalg.lstsq(slopes, rows.T, rcond=None)[0]
    return rp.RepeatableInverse(task, basis.weighted(A))


@pytest.mark.parametrize("both", [False, True])
def test_the_hands_come_back_under_j_plus_and_the_joints_do_not(hands, constant, both):
    task, q0 = hands
    path = rp.several_paths(task, q0, [circle, circle if both else None])
    plain = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=2, steps=150)
    closed = rp.follow(constant, path, q0, cycles=2, steps=150)
    assert plain.drift[-1] > 1e-3
    assert closed.drift[-1] < 1e-8
    assert max(plain.tracking_error.max(), closed.tracking_error.max()) < 1e-7


def test_the_law_in_c_is_that_in_numpy(hands, constant, monkeypatch):
    task, q0 = hands
    path = rp.several_paths(task, q0, [circle, circle])
    target, twist = path.placement(0.02), path.twist(0.02)
    leaf, xdot = constant.leaf(q0), np.arange(1.0, task.m + 1)
    monkeypatch.setenv("REPCTL_NATIVE", "no")
    plain = rp.RepeatableInverse(task, constant.potentials)
    for call in (
        lambda law: law.velocity(q0, xdot),
        lambda law: law.step(q0, target, 0.01, twist, leaf=leaf, gain=20.0),
        lambda law: law.step(q0, target, 0.01, leaf=leaf, velocity_limit=1.0, damping=0.1),
        lambda law: law.batch(q0[None] + 0.01),
    ):
        expected = call(plain)
        monkeypatch.setenv("REPCTL_NATIVE", "")
        np.testing.assert_allclose(call(constant), expected, rtol=0, atol=1e-10)
        monkeypatch.setenv("REPCTL_NATIVE", "no")


def test_targets_on_a_leaf_are_solved(hands, constant):
    task, q0 = hands
    target = task.placements(q0 + 0.02)
    for q in (constant.solve(target, q0), rp.solve_ik(task, q0, target)):
        assert np.abs(task.error(q, target)).max() < 1e-9


def test_paths_of_several_frames_are_checked(hands):
    task, q0 = hands
    with pytest.raises(rp.InputError, match="1 paths for 2 frames"):
        rp.several_paths(task, q0, [circle])
    with pytest.raises(rp.InputError, match="holds every frame still"):
        rp.several_paths(task, q0, [None, None])
    with pytest.raises(rp.InputError, match="must have for each frame a closed path"):
        rp.several_paths(task, q0, [circle, 3])
    with pytest.raises(rp.InputError, match="2 placements, one per frame"):
        rp.follow(
            rp.Pseudoinverse(task),
            rp.circle(task.single_tasks[0], task.single_tasks[0].reference, 0.05),
            q0,
        )


@pytest.mark.slow
def test_a_problem_of_pr2_moves_one_frame_and_holds_the_other():
    both = rp.Problem("pr2", frame=HANDS, path=["circle:0.05", None])
    left, right = both.path.paths
    assert left.length > 0.3 and right.length == 0


def test_a_problem_moves_one_frame_and_holds_the_other(tmp_path):
    both = rp.Problem(two_armed(tmp_path).task, start=FLAT, path=["circle:0.05", None])
    left, right = both.path.paths
    assert left.length > 0.3 and right.length == 0


@pytest.fixture(scope="module")
def study(hands):
    """One hand moves, the other holds still."""
    task, q0 = hands
    path = rp.several_paths(task, q0, [circle, None])
    return rp.study(rp.Problem(task, start=q0, path=path), cycles=2, steps=200, degree=1)


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    """The same of a flat robot with a waist and two arms of three joints."""
    task = two_armed(tmp_path_factory.mktemp("flat")).task
    path = rp.several_paths(task, FLAT, [circle, None])
    return rp.study(rp.Problem(task, start=FLAT, path=path), cycles=2, steps=100, degree=1)


@pytest.mark.slow
def test_a_study_of_hands_that_collide_calls_no_hand_back(study):
    """The fingers of one gripper meet those of the other, under every control."""
    assert study.row("pseudoinverse").motion.drift[-1] > 1e-2
    assert study.row("repeatable").motion.drift[-1] < 1e-9
    assert all(row.motion.first_touch for row in study.rows)
    page = rp.animation(study).page
    assert "hands are back" not in page.split("<script")[0] and "left upper arm is not back" in page
    assert "No motion without a collision was found: under either control, " in page


@pytest.mark.slow
def test_the_page_traces_both_hands_and_has_a_ring_for_each(flat):
    page = rp.animation(flat).page
    assert "After 2 cycles both hands are back" in page
    scene, *_ = read(page)
    assert len(scene["paths"]) == len(scene["own"]["frames"]) == 2
    assert [arm["chains"] for arm in scene["arms"]] == [2, 2]


@pytest.mark.slow
def test_a_design_of_several_frames_is_saved_and_loaded(flat, tmp_path):
    design = flat.design
    file = rp.save(design, tmp_path / "hands.json")
    again = rp.load_design(file, design.task)
    q0 = design.cycle.start
    np.testing.assert_array_equal(again.inverse(q0), design.inverse(q0))
    assert again.cycle.path.name == design.cycle.path.name
    for s in (0.0, 0.3, 0.7):
        one, other = again.cycle.path, design.cycle.path
        np.testing.assert_allclose(one.twist(s), other.twist(s), rtol=0, atol=1e-9)
    other = design.task.robot.task([("left", "position"), ("right", "xy")])
    with pytest.raises(rp.InputError, match="hands.json is for"):
        rp.load_design(file, other)


def table(task, q0, file, header, frames):
    """Write a CSV of waypoints: a triangle of each frame, from where it is at q0."""
    corners = 0.05 * np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]])
    start = [task.placements(q0)[k].translation for k in frames]
    np.savetxt(
        file, np.hstack([p + corners for p in start]), delimiter=",", header=header, comments=""
    )
    return rp.Problem(task, start=q0, path=str(file))


def test_a_csv_names_the_frames_that_move(hands, tmp_path):
    task, q0 = hands
    both = "l_gripper.x,l_gripper.y,l_gripper.z,r_gripper_tool_frame.x,r_gripper_tool_frame.y,"
    file = tmp_path / "loop.csv"
    path = table(task, q0, file, f"{both}r_gripper_tool_frame.z", [0, 1]).path
    assert [round(one.length, 3) for one in path.paths] == [0.171, 0.171]
    for k, moved in enumerate(path.placement(1 / 3)):
        way = moved.translation - task.placements(q0)[k].translation
        assert np.linalg.norm(way) > 0.04
    right = table(task, q0, file, "r_.x,r_.y,r_.z", [1]).path
    assert [one.length > 0 for one in right.paths] == [False, True]
    plain = table(task, q0, file, "x,y,z", [0]).path
    assert [one.length > 0 for one in plain.paths] == [True, False]
    with pytest.raises(rp.InputError, match="columns are named|of several frames"):
        table(task, q0, file, "r_.x,r_.y,r_.z", [1])
        rp.read_waypoints(file)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("gripper.x,gripper.y,gripper.z", "more than one frame"),
        ("left.x,left.y,left.z", "is part of no frame's name .l_gripper_tool_frame"),
        ("l_.x,l_.y,z", "column 'z' names no frame"),
        ("l_.x,l_.y,l_.w", "name them x, y, z"),
    ],
)
def test_columns_of_no_frame_are_refused_in_one_line(hands, tmp_path, header, message):
    with pytest.raises(rp.InputError, match=message) as refused:
        table(*hands, tmp_path / "loop.csv", header, [0])
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_an_audit_counts_visits_of_both_hands(hands, constant):
    """Both hands return and the joints do not; or the left one alone, while the right climbs."""
    task, q0 = hands
    path = rp.several_paths(task, q0, [circle, circle])
    plain = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=6, steps=80)
    found = rp.audit((plain.t, plain.q), task)
    assert found.drifts and found.returns == 6
    closed = rp.follow(constant, path, q0, cycles=6, steps=80)
    assert rp.audit((closed.t, closed.q), task)
    right, leaf, Q = task.placements(q0)[1], constant.leaf(q0), [q0]
    for k in range(1, 481):
        left = path.placement(k / 80 % 1.0)[0]
        right = pin.SE3(right.rotation, right.translation - [0, 0, 1e-4])
        Q.append(constant.step(Q[-1], (left, right), 0.0625, leaf=leaf))
    log = np.array(Q)
    assert rp.audit((plain.t, log), task).verdict == "no return"
    alone = task.single_tasks[0]
    own = [task.joint_names.index(joint) for joint in alone.joint_names]
    assert rp.audit((plain.t, log[:, own]), alone).returns == 6


def test_the_torques_of_a_tree_pull_both_hands_home(hands, constant):
    """J M⁻¹ (τ − b) is the spring's acceleration of both hands, and h is not moved."""
    task, q0 = hands
    spring = rp.LeafImpedance(constant, stiffness=(400.0, 30.0))
    still, leaf = np.zeros(task.n), constant.leaf(q0)
    target = task.placements(q0 + 0.01)
    change = spring.torque(q0, still, target, leaf=leaf)
    change -= spring.torque(q0, still, task.placements(q0), leaf=leaf)
    M, J = task.inertias(q0[None])[0], task.jacobian(q0)
    qddot = np.linalg.solve(M, change)
    K = np.where(task.kind.linear, 400.0, 30.0)
    Lambda = np.linalg.inv(J @ np.linalg.solve(M, J.T))
    np.testing.assert_allclose(Lambda @ J @ qddot, K * task.error(q0, target), atol=1e-7)
    V = constant.potentials.gradient(q0)
    np.testing.assert_allclose(V.T @ qddot, 0, atol=1e-7)


def test_what_takes_one_frame_only_says_so(hands, constant):
    task, q0 = hands
    here = task.placements(q0)[0]
    for call in (
        lambda: rp.Cell(task, here, 0.1),
        lambda: rp.Sector(task, here, radius=0.1, angle="all"),
        lambda: rp.Recording(task, joints=np.tile(q0, (5, 1))),
        lambda: rp.WorkspaceBox(task, q0[:3], 0.1, within=rp.Box(q0, 0.1)),
        lambda: rp.ArmAngle(task, "a", "b", "c"),
        lambda: rp.Viewer(task, ["a"]),
    ):
        with pytest.raises(rp.InputError, match="takes a task of one frame") as refused:
            call()
        assert "\n" not in str(refused.value)
