"""A governor that keeps a distance between bodies, also between its samples, and can leave them."""

from __future__ import annotations

import pickle
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from controls import control

import repctl_pin as rp

DT, A, J, D = 0.002, 6.0, 400.0, 0.02
Q0 = np.array([0.3, 0.8, 0.8])
LIMITS = rp.Limits(velocity=2.0, acceleration=A, jerk=J)

LINK = """<joint name="j{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/>
<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
<link name="l{k}"><collision><origin xyz="0.25 0 0" rpy="0 1.5708 0"/>
<geometry><cylinder radius="0.03" length="0.4"/></geometry></collision></link>"""
TOOL = """<joint name="e" type="fixed"><parent link="l3"/><child link="tool"/>
<origin xyz="0.5 0 0"/></joint><link name="tool"/>"""
POST = """<robot name="w"><link name="room"/><link name="{name}"><collision><geometry>
<box size="{size}"/></geometry></collision></link><joint name="a" type="fixed">
<parent link="room"/><child link="{name}"/><origin xyz="{at}"/></joint></robot>"""


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> rp.Task:
    """Planar arm of three cylinders beside a wire of 1 mm."""
    folder = tmp_path_factory.mktemp("arm")
    links = "".join(LINK.format(k=k, before=k - 1, x=0.5 * (k > 1)) for k in (1, 2, 3))
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="l0"/>{links}{TOOL}</robot>')
    around = folder / "post.urdf"
    around.write_text(POST.format(name="post", size="0.001 0.001 1", at="0.6 1.15 0"))
    return rp.Robot.load(folder / "arm.urdf", surroundings=around).task("tool", "xy")


@pytest.fixture(scope="module")
def lacking(tmp_path_factory: pytest.TempPathFactory) -> rp.Task:
    """The same arm, whose second link has a mesh that is missing."""
    folder = tmp_path_factory.mktemp("lacking")
    links = [LINK.format(k=k, before=k - 1, x=0.5 * (k > 1)) for k in (1, 2, 3)]
    mesh = '<mesh filename="package://gone/l2.stl"/>'
    links[1] = links[1].replace('<cylinder radius="0.03" length="0.4"/>', mesh)
    text = f'<robot name="arm"><link name="l0"/>{"".join(links)}{TOOL}</robot>'
    (folder / "arm.urdf").write_text(text)
    around = folder / "post.urdf"
    around.write_text(POST.format(name="post", size="0.001 0.001 1", at="0.6 1.15 0"))
    return rp.Robot.load(folder / "arm.urdf", surroundings=around).task("tool", "xy")


def governed(task: rp.Task, **more: object) -> rp.Governor:
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    governor = rp.Governor(inverse, DT, LIMITS, **more)  # type: ignore[arg-type]
    governor.start(Q0)
    return governor


def beyond(task: rp.Task, x: float, y: float) -> pin.SE3:
    place = task.placement(Q0)
    return pin.SE3(place.rotation, place.translation + [x, y, 0.0])


def between(Q: np.ndarray, count: int) -> np.ndarray:
    """Configurations on the straight lines between samples."""
    shares = np.arange(count)[:, None, None] / count
    return (Q[:-1] + shares * np.diff(Q, axis=0)).reshape(-1, Q.shape[1])


def test_the_distance_is_kept_between_samples_and_the_arm_leaves(task: rp.Task) -> None:
    """Random targets and twists, most of them beyond the wire."""
    governor = governed(task, bodies=rp.Bodies(task), body_distance=D)
    assert governor.nearest_bodies is None
    rng, Q, stops = np.random.default_rng(2), [Q0] * 4, set()
    for k in range(12):
        twist = rng.normal(size=6) * [1, 1, 0, 0, 0, 0] if k % 3 == 0 else None
        target = None if k % 3 == 0 else beyond(task, *rng.normal(size=2) * 0.2 + [0, 0.1])
        for _ in range(200):
            q, status = governor.step(target, twist)
            Q.append(q)
            if status is rp.Status.BODIES:
                assert governor.nearest_bodies is not None
                stops.add(governor.nearest_bodies)
            else:
                assert governor.nearest_bodies is None
    assert ("l3", "post") in stops
    ways = np.array(Q)
    distances = rp.Bodies(task).distances(between(ways, 3))
    assert D <= distances.min() < D + 0.003  # it comes as near as it may
    for k, most in enumerate((2.0, A, J), 1):
        assert np.abs(np.diff(ways, k, axis=0)).max() / DT**k <= most * (1 + 1e-9)
    for _ in range(2000):
        q, status = governor.step(beyond(task, 0, 0))
        if status is rp.Status.OK:
            break
    assert status is rp.Status.OK and np.abs(q - Q0).max() < 1e-6


def test_the_distance_is_kept_while_the_level_moves(task: rp.Task) -> None:
    """Item 30.1: levels alone, and with poses; the wire is in the elbow's way."""
    q0, bodies = np.array([0.85, 0.34, 0.31]), rp.Bodies(task)
    governor = governed(task, bodies=bodies, body_distance=D)
    governor.start(q0)
    rng, Q, stops, home = np.random.default_rng(4), [q0] * 4, 0, governor.leaf
    place = task.placement(q0)
    for k in range(16):
        target, leaf = None, home + 0.4  # alone, from q0
        if k % 4 == 1:
            target = pin.SE3(place.rotation, place.translation + [*rng.normal(size=2) * 0.1, 0])
            leaf = home + rng.normal() * 0.4
        elif k % 4 == 2:
            leaf = home + rng.normal() * 0.4
        elif k % 4 == 3:
            target, leaf = place, home
        for _ in range(300):
            q, status = governor.step(target, leaf=leaf)
            Q.append(q)
            stops += status is rp.Status.BODIES and target is None
    assert stops > 50
    ways = np.array(Q)
    assert D <= bodies.distances(between(ways, 3)).min() < D + 0.003
    for k, most in enumerate((2.0, A, J), 1):
        assert np.abs(np.diff(ways, k, axis=0)).max() / DT**k <= most * (1 + 1e-9)
    for _ in range(3000):
        q, status = governor.step(place, leaf=home)
        if status is rp.Status.OK:
            break
    assert status is rp.Status.OK and np.abs(q - q0).max() < 1e-6


@pytest.mark.parametrize(("dt", "later"), [(0.0005, 1), (0.001, 1), (0.002, 0)])
def test_plans_are_allowed_in_the_next_tick(task: rp.Task, dt: float, later: int) -> None:
    """No tick of at most 1 ms both plans and measures distances, so the motion is one tick late."""
    inverse, bodies = control(task, Q0, rp.Polynomial(Q0, 2, 0.5)), rp.Bodies(task)
    free = rp.Governor(inverse, dt, LIMITS)
    kept = rp.Governor(inverse, dt, LIMITS, bodies=bodies, body_distance=D)
    ticks, ways = round(1 / dt), []
    for governor in (free, kept):
        governor.start(Q0)
        ways.append([governor.step(beyond(task, -0.05, -0.1)) for _ in range(ticks)])
    q, said = (np.array([q for q, _ in way]) for way in ways), [way[-1][1] for way in ways]
    alone, guarded = q
    assert said == [rp.Status.OK] * 2
    assert (guarded[later:] == alone[: ticks - later]).all()
    assert (guarded[:later] == Q0).all()


@pytest.mark.parametrize("dt", [0.001, 0.01])
def test_an_arm_that_was_stopped_leaves(task: rp.Task, dt: float) -> None:
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    governor = rp.Governor(inverse, dt, LIMITS, bodies=rp.Bodies(task), body_distance=D)
    governor.start(Q0)
    for _ in range(round(0.8 / dt)):
        q, status = governor.step(twist=[0, 0.3, 0, 0, 0, 0])
    assert status is rp.Status.BODIES
    assert D + 0.0009 < rp.Bodies(task).nearest(q).distance < D + 0.003
    stopped = task.placement(q).translation
    for _ in range(round(1.5 / dt)):
        q, _ = governor.step(twist=[0, -0.3, 0, 0, 0, 0])
    assert np.linalg.norm(task.placement(q).translation - stopped) > 0.1


def test_a_distance_changes_no_faster_than_its_bound(task: rp.Task) -> None:
    """|d(q) − d(q')| ≤ ρ·|q − q'| for every pair, also where the first joint slides."""
    path = task.robot.description.path
    text = path.read_text().replace("revolute", "prismatic", 1)
    sliding = path.with_name("sliding.urdf")
    sliding.write_text(text.replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"', 1))
    slid = rp.Robot.load(sliding, surroundings=path.with_name("post.urdf"))
    rng = np.random.default_rng(0)
    for own in (task, slid.task("tool", "xy")):
        guard = governed(own, bodies=rp.Bodies(own))._guard
        model, reach = guard._model, guard._reach
        every = np.arange(len(reach))
        largest = 0.0
        for _ in range(60):
            q = rng.uniform(own.lower, own.upper)
            other = q + 0.02 * rng.normal(size=own.n) * (rng.random(own.n) < 0.4)
            d, e = model.some_distances(q, every), model.some_distances(other, every)
            apart = (d > 0) & (e > 0)
            change, most = np.abs(d - e), reach @ np.abs(q - other)
            assert (change <= most + 3e-6)[apart].all()
            largest = max(largest, (change[apart] / (most[apart] + 1e-4)).max())
        assert largest > 0.9  # no bound of thin air


def test_far_bodies_change_no_bit(task: rp.Task, tmp_path: Path) -> None:
    far = tmp_path / "far.urdf"
    far.write_text(POST.format(name="post", size="1 1 1", at="9 9 9"))
    plain = governed(task)
    kept = governed(task, bodies=rp.Bodies(task, surroundings=far), body_distance=0.001)
    for _ in range(300):
        ours, theirs = (g.step(beyond(task, -0.1, 0.2)) for g in (plain, kept))
        assert (ours[0] == theirs[0]).all() and ours[1] is theirs[1]


def test_a_copy_goes_on_as_the_governor_does(task: rp.Task) -> None:
    governor = governed(task, bodies=rp.Bodies(task), body_distance=D)
    for _ in range(150):
        governor.step(beyond(task, 0.5, 0.1))
    copy = pickle.loads(pickle.dumps(governor))
    for _ in range(200):
        ours, theirs = (g.step(beyond(task, 0.5, 0.1)) for g in (governor, copy))
        assert (ours[0] == theirs[0]).all() and ours[1] is theirs[1]
    assert copy.nearest_bodies == governor.nearest_bodies


def test_other_motions_are_judged_too(task: rp.Task) -> None:
    bodies = rp.Bodies(task)
    governor = governed(task, bodies=bodies, body_distance=D)
    rng, answers = np.random.default_rng(3), []
    for _ in range(24):
        Q = np.linspace(Q0, Q0 + 0.6 * rng.normal(size=3), 40)
        answers.append(governor.keeps_distance(Q))
        if answers[-1]:
            assert bodies.distances(between(Q, 5)).min() >= D
    assert any(answers) and not all(answers)
    assert governed(task).keeps_distance(np.zeros((2, 3)))


FAULTS = [(DT, RuntimeError("a\nb")), (0.02, KeyboardInterrupt()), (0.001, MemoryError())]


@pytest.mark.parametrize(("dt", "raised"), FAULTS)
def test_a_fault_of_the_geometry_loses_no_command(
    task: rp.Task, dt: float, raised: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the middle of a motion; the tick, repeated, is the tick that the fault interrupted."""
    governor = rp.Governor(
        control(task, Q0, rp.Polynomial(Q0, 2, 0.5)),
        dt,
        LIMITS,
        bodies=rp.Bodies(task),
        body_distance=D,
    )
    governor.start(Q0)
    target, calls = beyond(task, 0.1, 0.3), 0
    for _ in range(3 + int(0.1 / dt)):
        last, _ = governor.step(target)
    untouched = pickle.loads(pickle.dumps(governor))

    def fails(*arguments: object, **options: object) -> None:
        nonlocal calls
        calls += 1
        raise raised

    faults = 0
    for _ in range(int(0.4 / dt)):
        with monkeypatch.context() as patch:
            patch.setattr(governor._guard, "allows", fails)
            calls = 0
            try:
                governor.step(target)
            except (rp.RepctlError, KeyboardInterrupt) as error:
                assert isinstance(error, KeyboardInterrupt) or "\n" not in str(error)
                assert calls == 1
                faults += 1
                assert (governor.q == last).all()
            else:
                last, _ = untouched.step(target)
                assert (governor.q == last).all()
                continue
        (now, status), (last, other) = governor.step(target), untouched.step(target)
        assert (now == last).all() and status is other
        assert governor.nearest_bodies == untouched.nearest_bodies
    assert faults > 3


@pytest.mark.parametrize("dt", [0.001, 0.02])
def test_an_interruption_after_any_tick_loses_no_command(
    task: rp.Task, dt: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl+C is raised when C has returned: after ticks with a plan, a question, or neither."""
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    governor = rp.Governor(inverse, dt, LIMITS, bodies=rp.Bodies(task), body_distance=D)
    governor.start(Q0)
    untouched = pickle.loads(pickle.dumps(governor))
    tick = governor._native.call_governor_step

    class Interrupted:
        call_governor_keep = governor._native.call_governor_keep
        call_governor_undo = governor._native.call_governor_undo

        @staticmethod
        def call_governor_step(*arguments: Any) -> None:
            tick(*arguments)
            raise KeyboardInterrupt

    rng = np.random.default_rng(1)
    for k in range(200):
        if k % 20 == 0:
            target = beyond(task, *rng.normal([0.0, 0.1], 0.2))
        with monkeypatch.context() as patch, suppress(KeyboardInterrupt):
            patch.setattr(governor, "_native", Interrupted)
            governor.step(target)
        (now, status), (same, other) = governor.step(target), untouched.step(target)
        assert (now == same).all() and status is other


def test_a_fault_at_a_later_question_of_a_tick_restores_what_the_guard_knows(
    task: rp.Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 20 Hz, a tick measures several times; the first measurements replace what is known."""
    governor = rp.Governor(
        control(task, Q0, rp.Polynomial(Q0, 2, 0.5)),
        0.05,
        LIMITS,
        bodies=rp.Bodies(task),
        body_distance=D,
    )
    governor.start(Q0)
    assert governor._guard is not None
    guard, rng = governor._guard, np.random.default_rng(0)
    measure = guard._model.some_distances
    faults = changed = calls = 0
    known: dict[str, np.ndarray] = {}

    def fails(*arguments: Any, **options: Any) -> Any:
        nonlocal calls, changed
        calls += 1
        if calls == 1:
            return measure(*arguments, **options)
        now = guard.remembered()["known"]
        changed += any((now[name] != values).any() for name, values in known.items())
        raise RuntimeError("geometry")

    for k in range(300):
        if k % 5 == 0:
            target = beyond(task, *rng.normal([0.0, 0.1], 0.2))
        before, calls = guard.remembered(), 0
        known = before["known"]
        with monkeypatch.context() as patch:
            patch.setattr(guard._model, "some_distances", fails)
            with suppress(rp.RepctlError):
                governor.step(target)
                continue
        faults += 1
        after = guard.remembered()
        assert all((after["known"][name] == values).all() for name, values in known.items())
        assert all(after[name] == before[name] for name in ("nearest", "next"))
        governor.step(target)
    assert faults > 10 and changed > 3


def test_a_failed_start_changes_nothing(task: rp.Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """The governor goes on from its command, and the guard with it.

    A guard that starts within 1 mm of the distance to keep lets these bodies come as near again.
    """
    bodies = rp.Bodies(task)
    governor = governed(task, bodies=bodies, body_distance=D, margin=2.0)
    near = np.linspace([-0.2, 1.0, -0.5], [0.59, 1.0, -0.5], 9000)
    near = near[np.argmin(np.abs(bodies.distances(near) - D - 3e-4))]
    assert D + 2e-4 < bodies.distances(near[None])[0] < D + 4e-4
    governor.start(near - [0.03, 0.02, 0.0])
    untouched = pickle.loads(pickle.dumps(governor))
    with monkeypatch.context() as patch:
        patch.setattr(type(governor._guard), "keeps", lambda self, Q: False)
        with pytest.raises(rp.InputError, match="on the straight motion back"):
            governor.start(near + [0, 0.05, 0])
    leaf = control(task, Q0, rp.Polynomial(Q0, 2, 0.5)).leaf(near)
    for _ in range(500):
        ours, theirs = (g.step(task.placement(near), leaf=leaf) for g in (governor, untouched))
        assert (ours[0] == theirs[0]).all() and ours[1] is theirs[1]
    assert ours[1] is rp.Status.BODIES


def test_a_question_about_another_motion_leaves_the_nearest_bodies(task: rp.Task) -> None:
    governor = governed(task, bodies=rp.Bodies(task), body_distance=D)
    for _ in range(800):
        _, status = governor.step(beyond(task, 0.0, 0.3))
        if status is rp.Status.BODIES:
            break
    before = governor.nearest_bodies
    assert before is not None
    governor.keeps_distance(np.linspace(Q0, [0.3, 2.9, 2.9], 40))
    assert governor.nearest_bodies == before


def test_what_it_refuses(task: rp.Task, tmp_path: Path) -> None:
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    near = tmp_path / "near.urdf"
    near.write_text(POST.format(name="wall", size="1 0.1 1", at="0.5 1.4 0"))
    walled = rp.Bodies(task, surroundings=near)
    planar = rp.Robot.load("planar3r").task("tool", "xy")
    empty = control(planar, Q0, rp.Polynomial(Q0, 2, 0.5))
    for own, bodies, distance, words in (
        (inverse, rp.Bodies(planar), D, "the bodies are of .* but the governor moves"),
        (inverse, walled, -1.0, "body_distance must be 0 m or more"),
        (inverse, task, D, "bodies must be"),
        (empty, rp.Bodies(planar), D, "there is no pair of bodies whose distance can change"),
    ):
        with pytest.raises(rp.InputError, match=words) as caught:
            rp.Governor(own, DT, LIMITS, bodies=bodies, body_distance=distance)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
    now = walled.nearest(Q0).distance
    governor = rp.Governor(inverse, DT, LIMITS, bodies=walled, body_distance=now + 1e-6)
    with pytest.raises(rp.InputError, match=r"l3 and wall are \d+\.?\d* mm apart, but"):
        governor.start(Q0)
    with pytest.raises(rp.InputError, match="has not started"):
        governor.step(twist=np.zeros(6))
    with pytest.raises(rp.InputError, match="surroundings"):
        rp.Bodies(task, surroundings=3)  # type: ignore[arg-type]


def test_the_work_of_a_tick_is_bounded_and_the_same_every_time(task: rp.Task) -> None:
    """Fast ticks towards and past the wire: at most 60 distances per tick, and the same motion."""
    motions = []
    for _ in range(2):
        governor = governed(task, bodies=rp.Bodies(task), body_distance=D)
        model, counts, Q = governor._guard._model, [], []
        measure = model.some_distances

        def counted(q, pairs, measure=measure, counts=counts, **how):  # type: ignore[no-untyped-def]
            counts[-1] += len(pairs)
            return measure(q, pairs, **how)

        model.some_distances = counted
        try:
            for k in range(1200):
                counts.append(0)
                Q.append(governor.step(beyond(task, *[(0.3, 0.2), (-0.4, 0.2)][k // 200 % 2]))[0])
        finally:
            del model.some_distances
        assert 0 < max(counts) <= 60
        motions.append(np.array(Q))
    assert np.abs(motions[0] - motions[1]).max() < 1e-9


def test_surfaces_are_bounded_from_below() -> None:
    """Pairs whose hulls overlap, although the torso's mesh is not convex."""
    own = rp.Robot.load("baxter").task("left_gripper")
    guard = governed_by(own)._guard
    model, every, seen = guard._model, np.arange(len(guard._reach)), 0
    rng = np.random.default_rng(3)
    for _ in range(3):
        q = guard._drive.joints(own.reference + 0.1 * rng.normal(size=own.n))
        slow, bound = (model.some_distances(q, every, outside=quick) for quick in (False, True))
        differ = np.flatnonzero(np.abs(bound - slow) > 1e-5)
        exact = np.array([model._exact_distance(k) for k in differ.tolist()])
        assert (bound[differ] > 0).all() and (bound[differ] <= exact + 1e-6).all()
        seen += len(differ)
    assert seen


def governed_by(task: rp.Task) -> rp.Governor:
    """A governor with bodies of a robot of the catalogue."""
    inverse = control(task, task.reference, rp.Polynomial(task.reference, 1, 0.5))
    return rp.Governor(inverse, DT, rp.Limits(acceleration=A), bodies=rp.Bodies(task))


def test_links_without_a_shape_are_refused_unless_allowed(lacking: rp.Task) -> None:
    """Item 26.5: a link whose mesh is missing was accepted in silence."""
    bodies = rp.Bodies(lacking)
    assert bodies.unchecked == ("l2",)
    with pytest.raises(
        rp.InputError, match="1 body without a collision shape.*: l2; .*unchecked"
    ) as caught:
        governed(lacking, bodies=bodies)
    assert "\n" not in str(caught.value)
    with pytest.raises(rp.InputError, match="unchecked"):
        governed(lacking, bodies=bodies, unchecked="yes")
    governor = governed(lacking, bodies=bodies, unchecked="allow")
    for _ in range(20):
        governor.step(beyond(lacking, 0.05, 0.05))
    assert (governor.q != Q0).any()


def test_a_distance_without_a_pair_is_said(lacking: rp.Task) -> None:
    """Item 26.5: ``nearest`` gave inf without a word."""
    planar = rp.Robot.load("planar3r").task("tool", "xy")
    with pytest.warns(UserWarning, match="no pair of bodies is checked.*base, link1, link2 and 1"):
        assert rp.Bodies(planar).nearest(Q0).distance == np.inf
    with pytest.warns(UserWarning, match="no pair of bodies"):
        assert rp.Bodies(planar).distances([Q0]).tolist() == [np.inf]
    path = rp.circle(lacking, Q0, radius=0.02)
    motion = rp.follow(rp.Pseudoinverse(lacking), path, Q0, cycles=1, steps=40)
    with pytest.warns(UserWarning, match="without a shape are not checked for collisions: l2"):
        rp.approach(Q0 + 0.1, motion, LIMITS)


@pytest.mark.parametrize(
    ("side", "gap", "starts"),
    [(1, 0.1, True), (1, 0.024, True), (1, 0.018, False), (-1, 0.1, True), (-1, 0.03, False)],
)
def test_the_way_back_inside_the_limits_keeps_the_distance(
    side: int, gap: float, starts: bool, tmp_path: Path
) -> None:
    """Item 26.4: near a post, the way back from beyond a joint limit keeps away, or is refused.

    The post is beside the end of the last cylinder, farther out (1) or further inside (-1).
    """
    links = [LINK.format(k=k, before=k - 1, x=0.5 * (k > 1)) for k in (1, 2, 3)]
    links[2] = links[2].replace('lower="-3" upper="3"', 'lower="-1" upper="1"')
    text = f'<robot name="arm"><link name="l0"/>{"".join(links)}{TOOL}</robot>'
    (tmp_path / "arm.urdf").write_text(text)
    q, inside = np.array([0.1, 0.5, 1.05]), np.array([0.1, 0.5, 1.0])
    elbow = 0.5 * np.exp(0.1j) + 0.5 * np.exp(0.6j)
    at = elbow + (0.44 + side * (0.0305 + gap) * 1j) * np.exp(1j * q.sum())
    post = tmp_path / "post.urdf"
    post.write_text(POST.format(name="post", size="0.001 0.001 1", at=f"{at.real} {at.imag} 0"))
    task = rp.Robot.load(tmp_path / "arm.urdf", surroundings=post).task("tool", "xy")
    inverse = control(task, inside, rp.Polynomial(inside, 2, 0.5))
    bodies = rp.Bodies(task)
    governor = rp.Governor(inverse, DT, LIMITS, bodies=bodies, body_distance=D)
    if not starts:
        with pytest.raises(rp.InputError, match="on the straight motion back|mm apart, but"):
            governor.start(q)
        return
    governor.start(q)
    Q, said = [q], []
    for _ in range(1200):
        now, status = governor.step(task.placement(inside))
        Q.append(now)
        said.append(status)
    assert said[0] is rp.Status.RECOVERING and said[-1] is rp.Status.OK and Q[-1][2] <= 1.0
    assert bodies.distances(between(np.array(Q), 3)).min() >= D
