"""A user's script that names everything at the door, for ``mypy --strict``; it is not run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import repctl_pin as rp


def robots() -> rp.Task:
    robot: rp.Robot = rp.Robot.load("planar3r")
    task: rp.Task = robot.task("tool", "xy")
    q0 = [0.3, 0.8, 0.8]
    q: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = task.check(q0, "q0")
    T = np.eye(4)
    error = task.error(q, T)
    print(rp.absolute_angles(task), task.jacobian(q0) @ np.ones(3), error)
    print(rp.solve_ik(task, q0, T), rp.solve_ik(task, q0, pin.SE3(T)))
    bodies = rp.Bodies(task)
    distance: float = bodies.nearest(q0).distance
    print(distance, bodies.distances([q0]).shape)
    return task


def strategies(task: rp.Task) -> None:
    q0, xdot = [0.3, 0.8, 0.8], [0.1, 0.0]
    print(rp.Pseudoinverse(task).velocity(q0, xdot))
    print(rp.WeightedInverse(task, "inertia").velocity(q0, xdot))
    print(rp.WeightedInverse(task, rp.LimitWeight(task)).batch([q0, q0]))
    print(rp.PostureControl(task, q0, gain=2.0).velocity(q0, xdot))
    print(rp.CustomInverse(task, lambda q: np.linalg.pinv(task.jacobian(q)))(q0))
    print(rp.ExtendedJacobian(task, q0).leaf(q0))
    arm = rp.Robot.load("panda").task()
    links = ("panda_link1", "panda_link4", "panda_link8")
    print(rp.ArmAngle(arm, *links, (0.0, 1.0, 0.0)).values([arm.reference]))


def potentials_and_regions(task: rp.Task) -> None:
    q0 = [0.3, 0.8, 0.8]
    polynomials = rp.Polynomial(q0, 2, 0.4)
    basis: rp.Joined = polynomials + rp.Fourier(3, 1)
    custom = rp.CustomPotentials([lambda q: float(q[0])], names=["q1"])
    box = rp.Box(q0, [0.3, 0.3, 0.2])
    print(basis.gradients([q0]), custom.gradients([q0]), box.contains([q0]), box.weights([q0]))
    print(rp.Tube([q0, q0], 0.1).clip([q0]))
    print(rp.WorkspaceBox(task, [1.0, 1.0], 0.2, within=box).ratio([q0]))
    print(rp.RepeatableInverse(task, polynomials.weighted([[1.0]] * polynomials.size)).leaf(q0))


def designs(task: rp.Task) -> rp.Design:
    q0 = [0.3, 0.8, 0.8]
    desired = rp.Pseudoinverse(task)
    options = rp.FitOptions(samples=512, held_out=512, seed=1)
    design: rp.Design = rp.nearest_repeatable(
        desired, None, rp.Box(q0, 0.4), degree="auto", options=options, progress=True
    )
    control: rp.RepeatableInverse = design.inverse
    c = control.leaf(q0)
    q = control.step(q0, np.eye(4), 0.01, [0.1, 0, 0, 0, 0, 0], leaf=c, outside="warn")
    step = control.damped_step(q, task.placement(q), 0.01, velocity_limit=[1, 1, 1], damping=0.1)
    slowed: float = step.slowed
    print(slowed, step.damping, control.velocity(q0, [0.1, 0.0], outside="raise"))
    print(control.solve(task.placement(q0), q0, leaf=[0.0]), control.batch([q0, q0]))
    fast: rp.RepeatableInverse = control
    print(fast.velocities([q0], [[0.1, 0.0]]), rp.export_c(control, "c", name="arm"))
    print(rp.save(design, "d.json"), rp.load("d.json", task))
    again: rp.Design = rp.load_design("d.json", task)
    spring = rp.LeafImpedance(again.inverse, stiffness=(1000.0, 50.0), observer_limit=[5, 5, 2])
    print(spring.torque(q0, [0, 0, 0], np.eye(4), leaf=c, observer=spring.observer(0.001)))
    print(rp.redundancy.nullspace(task.jacobian(q0)))
    proof: rp.Proof = rp.prove(design, margin=0.1, seconds=1.0)
    closes: rp.ClosingRadius | None = proof.closes
    assert closes is not None
    print(bool(proof), proof.leaf_margin)
    own: rp.PathCertificate = rp.path_certificate(design.inverse, rp.circle(task, q0, 0.1), q0)
    print(own.shrinks, own.words)
    return again


def cells(task: rp.Task) -> None:
    poses: Sequence[pin.SE3] = [task.placement([0.3, 0.8, 0.8])]
    sector: rp.Cell = rp.Sector(task, poses[0], radius=0.1, angle="all")
    print(sector.at(np.zeros(sector.k)))
    cell: rp.Cell = rp.Cell.around(task, poses, margin=[0.05, 0.05])
    found: rp.CellDesign = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Cell(task, np.eye(4), 0.1),
        posture=[0.3, 0.8, 0.8],
        degree=2,
        incomplete="shrink",
        options=rp.FitOptions(held_out=64),
    )
    function: rp.InverseFunction = found.function
    print(rp.arrays.inverse_function(function, np)(np.eye(4)))
    moved: rp.MotionBetween = rp.motion_between(
        function, poses, rp.Limits(acceleration=5.0), blend=0.01
    )
    print(moved.at([0.0, 0.1]), moved.rests, moved.lines)
    print(function(np.eye(4), leaf=[0.0]), function.batch(poses), function.leaves(poses[0]), cell)
    print(
        function.batch(np.eye(4)[None], leaf=[[0.0]], missing="nan"),
        function.pose_and_leaf(np.zeros((1, 3))),
    )
    saved: rp.CellDesign = rp.load_cell(rp.save(found, "cell.json"))
    print(saved.summary())


def recordings(task: rp.Task) -> rp.Relabeled:
    recording = rp.Recording(task, joints=[[0.3, 0.8, 0.8]], times=[0.0], sessions=["one"])
    recording = rp.Recording.read("demos.csv", task)
    relabeled: rp.Relabeled = rp.relabel(recording, leaf=[0.1], options=rp.FitOptions(seed=1))
    print(relabeled.save("new.csv"), relabeled.summary(), relabeled.residual_before, len(recording))
    return rp.relabel(rp.Recording(task, poses=np.eye(4)[None]), design=rp.load_cell("cell.json"))


def questions(task: rp.Task) -> bool:
    control, box = rp.Pseudoinverse(task), rp.Box([0.3, 0.8, 0.8], 0.3)
    place: rp.BestCell = rp.best_cell(task, [0.2, 0.1], at=[1, 0, 0])
    print(place.cell, place.posture, place.factor, place.reason)
    print(rp.bracket_defect(control, [0.3, 0.8, 0.8]), rp.stable_surface(control, box).summary())
    print(rp.drift_per_area(control, [0.3, 0.8, 0.8]))
    return bool(rp.is_repeatable(control, box))


def motions(task: rp.Task, design: rp.Design) -> rp.Motion:
    q0 = [0.3, 0.8, 0.8]
    path: rp.TaskPath = rp.circle(task, q0, 0.1, normal="z", rotation="fixed")
    given: rp.Waypoints = rp.read_waypoints("square.csv")
    corners = [[0.1, 0, 0], [0.1, 0.1, 0]]
    paths = [
        rp.figure_eight(task, q0),
        rp.several_paths(task, q0, [None]),
        rp.polygon(task, q0, corners),
        rp.waypoints(given),
    ]
    paths += [rp.waypoints([[1, 0, 0], [1, 1, 0], [0, 0, 0], [1, 0, 0]], np.eye(3))]
    paths += [rp.waypoints([np.eye(4), path.placement(0.5), np.eye(4)])]
    motion: rp.Motion = rp.follow(design.inverse, path, q0, cycles=2, integrator="rk4")
    lock = rp.LeafLock(2, velocity_limit=[1, 1, 1], damping=0.1)
    motion = rp.follow(design.inverse, path, q0, cycles=2, integrator=lock)
    best: rp.BestLeaf = rp.best_leaf(design.inverse, paths[0], q0, region=design.region)
    best = rp.best_leaf(design.inverse, paths[0], q0, by="speed")
    least: rp.Motion = rp.least_closed_motion(task, path, q0, free_start=True, guess=motion)
    print(least.rms_speed, rp.least_closed_motion(task, path, q0, steps=64, limit_margin=0.1).q)
    fast: rp.TimedMotion = rp.timed(motion, rp.Limits(acceleration=[1, 1, 1], velocity=2.0))
    run: rp.Run = rp.Run(fast)
    q, qdot = run.step(0.01)
    governor: rp.Governor = rp.Governor(
        design.inverse, 0.001, rp.Limits(acceleration=5.0), margin=0.1
    )
    governor.start(q0)
    beyond: bool | None = governor.beyond_closing_radius
    print(beyond, design.inverse.same_leaf(q0, governor.q))
    status: rp.Status
    q, status = governor.step(path.placement(0.1))
    print(status is rp.Status.OK, governor.step(twist=[0.1, 0, 0, 0, 0, 0]), governor.leaf)
    toward = design.inverse.leaf_toward(q, elbow=design.inverse.elbow(q0), margin=0.01)
    q, status = governor.step(path.placement(0.1), leaf=toward.leaf)
    print(toward.q, toward.distance, toward.unique)
    clutch: rp.Clutch = rp.Clutch(scale=0.5)
    clutch.engage(path.placement(0.2), path.placement(0.1))
    print(clutch.target(path.placement(0.3)), clutch.engaged, governor.nearest_bodies)
    print(governor.keeps_distance(np.stack([q0, q])))
    clutch.release()
    print(q, qdot, best.q0, rp.approach(q0, motion, rp.Limits(acceleration=5)).duration)
    print(rp.write_motion(fast, "motion.csv"))
    return motion


def pictures(task: rp.Task, motion: rp.Motion) -> rp.Study:
    page: rp.Animation = rp.animation({"J⁺": motion})
    print(page.save("page.html"))
    viewer = rp.Viewer(task, ["J⁺"], start=[0.3, 0.8, 0.8])
    viewer.show([0.3, 0.8, 0.8])
    study: rp.Study = rp.study("panda", cycles=10, progress=print)
    print(study.summary(), rp.study(rp.Problem("panda", kind="pose", start=[0.0] * 7)))
    found: rp.Audit = rp.audit((motion.t, motion.q), task, degrees=False)
    print(bool(found), found.returns, found.rate, found.summary(), rp.audit("log.csv", "panda"))
    return study


def errors() -> str:
    try:
        robots()
    except rp.NoFunctionError as error:
        return f"{error} {error.fits}"
    except rp.SingularRegionError as error:
        return f"{error} {error.at}"
    except (rp.UrdfError, rp.InputError, rp.SingularityError) as error:
        return str(error)
    except rp.RepctlError:
        return rp.__version__
    return ""
