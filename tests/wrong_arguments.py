"""Wrong arguments for everything at the door: the right calls, the values to spoil them with, and
what came of it.

    python tests/wrong_arguments.py [--seed 0] [--count 10000]

spoils so many calls at random, one or two arguments each, and prints what was not refused by name.
"""

from __future__ import annotations

import argparse
import inspect
import signal
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from store import study_of

import repctl_pin as rp

PATIENCE = 60.0
"""Seconds after which a call counts as hung."""

RESULTS = {
    "Animation",
    "Audit",
    "BestCell",
    "BestLeaf",
    "ClosingRadius",
    "Design",
    "Motion",
    "MotionBetween",
    "PathCertificate",
    "Proof",
    "Robot",
    "Waypoints",
    "Study",
    "Task",
    "TimedMotion",
}
"""Classes that functions make, not people: their methods are tried, their constructors are not."""

MADE = {"CellDesign", "InverseFunction", "Relabeled", "Status"}
"""Classes that are made by functions only: their methods are tried, their constructors are not."""


@dataclass(frozen=True)
class Call:
    """A call that is right, and what it is called."""

    name: str
    function: Callable[..., Any]
    good: dict[str, Any]


_LINKS = ("base", "shoulder", "upper", "lower", "hand", "tip")
_BODY = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.05"/></geometry></collision>'
)
_AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
ARM_URDF = (
    '<robot name="arm">'
    + "".join(f'<link name="{name}">{_BODY}</link>' for name in _LINKS)
    + "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{above}"/><child link="{below}"/>'
        f'<origin xyz="0 0 0.3"/>'
        f'<axis xyz="{axis}"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, ((above, below), axis) in enumerate(zip(pairwise(_LINKS), _AXES, strict=True))
    )
    + "</robot>"
)
"""An arm of five joints in space, with bodies and inertias."""


def right_calls(folder: Path) -> list[Call]:
    """Make a right call of every public function, class and method; all of them small."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    robot, q0 = task.robot, np.array([0.3, 0.8, 0.8])
    Q, Xdot, target = (
        q0 + np.array([[0.0, 0, 0], [0.1, 0, 0.05]]),
        np.ones((2, 2)),
        task.placement(q0 + 0.02),
    )
    control, box = rp.Pseudoinverse(task), rp.Box(q0, 0.2)
    potentials, waves = rp.Polynomial(q0, 2, 0.2), rp.Fourier(3, 1)
    joined, custom = (
        potentials + waves,
        rp.CustomPotentials([lambda q: q[0], lambda q: q[1] * q[2]]),
    )
    path = rp.circle(task, q0, 0.05)
    square = (
        np.array([[0, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0], [0, 0, 0]])
        + path.placement(0.0).translation
    )
    waypoint_file = folder / "square.csv"
    waypoint_file.write_text("\n".join(",".join(map(str, row)) for row in square), encoding="utf-8")
    design = rp.nearest_repeatable(
        control, potentials, box, options=rp.FitOptions(samples=64, held_out=256)
    )
    inverse, tube = design.inverse, rp.Tube(Q, 0.2)
    middle = task.placement(q0).translation[:2]
    workspace = rp.WorkspaceBox(task, middle, 0.2, within=box)
    motion = rp.follow(inverse, path, q0, cycles=2, steps=24, integrator=rp.LeafLock())
    study = study_of("planar3r", 2, 100)
    timed = rp.timed(motion, rp.Limits(acceleration=10.0), rate=100.0)
    started = rp.Governor(inverse, 0.01, rp.Limits(velocity=1.0, acceleration=5.0))
    started.start(q0)
    limits = rp.Limits(acceleration=10.0, velocity=1.0, jerk=1000.0)
    saved = rp.save(design, folder / "design.json")
    cell = rp.Cell(task, target, (0.05, 0.05))
    found = rp.nearest_inverse_function(
        control, cell, degree=1, options=rp.FitOptions(samples=16, held_out=64)
    )
    between = [cell.at(u) for u in ([0.0, 0.0], [0.5, 0.0], [0.5, 0.5])]
    near = q0 + np.linspace(0.01, 0.03, 30)[:, None]
    recording = rp.Recording(task, joints=near, times=np.arange(30))
    relabeled = rp.relabel(recording, design=found)
    frames_file = relabeled.save(folder / "frames.csv")
    saved_cell = rp.save(found, folder / "cell.json")
    arm_file = folder / "arm.urdf"
    arm_file.write_text(ARM_URDF, encoding="utf-8")
    arm = rp.Robot.load(arm_file).task("tip", "position")
    angle = rp.ArmAngle(arm, "upper", "lower", "hand", (0.0, 1.0, 0.0))
    viewer = rp.Viewer(task, ["J⁺"], start=q0)
    viewer.close()
    functions: dict[str, dict[str, Any]] = {
        "absolute_angles": {"task": task},
        "animation": {"motions": {"J⁺": motion}, "seconds": 1.0},
        "best_leaf": {
            "inverse": inverse, "path": path, "q0": q0, "region": box, "desired": control,
            "by": "speed", "steps": 8, "seed": 0,
        },  # fmt: skip,
        "bracket_defect": {"strategy": control, "q": q0, "relative": False},
        "circle": {
            "task": task, "q0": q0, "radius": 0.05, "normal": "z", "start_angle": 0.0,
            "rotation": "fixed",
        },
        "drift_per_area": {"strategy": control, "q": q0},
        "figure_eight": {"task": task, "q0": q0, "radius": 0.05, "normal": "z", "start_angle": 0.0},
        "follow": {
            "strategy": inverse, "path": path, "q0": q0, "cycles": 1, "steps": 12,
            "integrator": "rk4", "feedback": 0.0,
            "period": 5.0, "task": task,
        },
        "best_cell": {
            "task": task, "size": 0.2, "orientation": None, "approach": None, "yaw": 0.0,
            "at": None, "options": rp.FitOptions(samples=16, held_out=64),
        },
        "is_repeatable": {"strategy": control, "region": box, "samples": 8, "seed": 0},
        "least_closed_motion": {
            "task": task, "path": path, "q0": q0, "steps": 8, "period": 5.0, "free_start": False,
            "limit_margin": 0.0, "guess": motion,
        },
        "load": {"path": saved, "task": task},
        "load_cell": {"path": saved_cell, "task": task},
        "load_design": {"path": saved, "task": task, "frame": None},
        "LeafLock": {
            "corrections": 1, "leaf": inverse.leaf(q0), "velocity_limit": 3.0, "damping": 0.01,
        },
        "FitOptions": {
            "samples": 64, "held_out": 64, "seed": 0, "restarts": 0, "tolerance": 1e-3,
        },
        "nearest_repeatable": {
            "desired": control, "potentials": potentials, "region": box, "degree": None,
            "shrink": False, "options": rp.FitOptions(samples=64, held_out=64), "progress": False,
        },
        "polygon": {
            "task": task, "q0": q0, "corners": [[0.1, 0, 0], [0.1, 0.1, 0]], "blend": 0.0,
            "name": "tri",
        },
        "prove": {
            "what": design, "margin": 0.1, "limit_margin": -1.0, "seconds": 0.2, "progress": False,
        },
        "path_certificate": {"inverse": inverse, "path": path, "q0": q0},
        "read_waypoints": {"file": waypoint_file},
        "Recording": {
            "task": task, "joints": near, "poses": None, "times": np.arange(30),
            "sessions": [1] * 30,
        },
        "relabel": {
            "recording": recording, "design": found, "leaf": [0.0],
            "options": rp.FitOptions(samples=16, held_out=64), "progress": False,
        },
        "save": {"design": design, "path": folder / "again.json"},
        "several_paths": {"task": task, "q0": q0, "paths": [path]},
        "solve_ik": {
            "task": task, "q0": q0, "target": target, "tolerance": 1e-9, "iterations": 20,
            "limits": True,
        },
        "stable_surface": {"strategy": control, "region": box, "samples": 8, "seed": 0},
        "Problem": {
            "robot": "planar3r", "frame": "tool", "kind": "xy", "start": q0,
            "path": None,
            "plane": "xy", "region": 0.1,
        },
        "study": {
            "robot": "planar3r", "cycles": 1, "steps": 24, "period": 5.0, "degree": 1,
            "weight": None, "controls": {"mine": control},
            "options": rp.FitOptions(samples=64, held_out=64), "progress": None,
        },
        "audit": {
            "log": (motion.t, motion.q), "robot": task, "degrees": False, "tolerance": 0.01,
        },
        "waypoints": {
            "points": square, "rotation": np.eye(3), "times": None, "blend": 0.0, "name": "square",
        },
        "Limits": {
            "acceleration": 10.0, "velocity": 1.0, "jerk": 1000.0, "torque": False,
            "tool_speed": [0.5, 3.0],
        },
        "timed": {
            "motion": motion, "limits": limits, "keep_times": False, "rate": 100.0,
        },
        "Run": {"timed": timed, "q": timed.q[0]},
        "Governor": {
            "inverse": inverse, "dt": 0.01, "limits": limits, "margin": 0.1,
            "closes": rp.prove(design, closes=0.001).closes, "bodies": None, "body_distance": 0.02,
        },
        "Clutch": {"scale": 0.5, "rotation_scale": 0.5, "axes": np.eye(3)},
        "motion_between": {
            "F": found.function, "poses": between, "limits": limits, "blend": 0.005,
            "rate": 100.0, "progress": False,
        },
        "write_motion": {"motion": motion, "file": folder / "motion.csv", "allow_violations": True},
        "approach": {
            "q_now": q0 + 0.05, "motion": motion, "limits": limits, "to": "nearest",
            "rate": 100.0, "bodies": False,
        },
        "export_c": {
            "control": inverse, "folder": folder / "c", "name": "arm_control", "region": box,
            "closes": rp.prove(design, closes=0.001).closes,
        },
        "nearest_inverse_function": {
            "desired": control, "cell": cell, "posture": q0, "degree": 1, "limit_margin": 0.05,
            "body_distance": 0.0, "sigma_min": 0.0,
            "incomplete": "refuse", "options": rp.FitOptions(samples=16, held_out=64),
            "progress": False,
        },
        "ArmAngle": {
            "task": arm, "shoulder": "upper", "elbow": "lower", "wrist": "hand",
            "reference": (0.0, 1.0, 0.0),
            "singular": (1.0, 0.0, 0.0),
        },
        "Bodies": {"task": task, "surroundings": None},
        "Viewer": {"task": task, "names": ["J⁺"], "path": path, "start": q0, "port": 0},
        "Cell": {"task": task, "placement": target, "half_width": (0.05, 0.05), "half_angle": 0.0},
        "Sector": {
            "task": task, "placement": target, "radius": 0.05, "height": 0.0, "angle": 0.5,
            "half_angle": 0.0, "spin": 0.0, "axis": [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        },
        "LeafImpedance": {
            "inverse": inverse, "stiffness": (1000.0, 50.0), "damping": 1.0,
            "leaf_frequency": 5.0, "leaf_damping": 1.0,
            "observer_rate": 100.0, "observer_limit": 5.0,
        },
        "Box": {"center": q0, "half_width": 0.2, "density": lambda Q: np.ones(len(Q))},
        "CustomInverse": {"task": task, "function": control, "tolerance": 1e-8},
        "ExtendedJacobian": {
            "task": task, "potential": q0, "gradient": None, "hessian": None, "reference": q0,
        },
        "Fourier": {"n": 3, "order": 1, "variables": [0, 1], "period": 6.0, "cross": True},
        "Joined": {"parts": potentials},
        "LimitWeight": {"task": task, "gain": 1.0, "onset": 0.1},
        "Polynomial": {"center": q0, "degree": 2, "scale": 0.2, "variables": [0, 2], "cross": True},
        "PostureControl": {"task": task, "posture": q0, "gain": 1.0},
        "CustomPotentials": {"functions": [lambda q: q[0]], "names": ["q1"]},
        "Pseudoinverse": {"task": task},
        "RepeatableInverse": {"task": task, "potentials": inverse.potentials},
        "TaskPath": {
            "name": "mine", "point": path.point, "slope": path.slope, "rotation": np.eye(3),
            "breaks": (0.5,),
        },
        "Tube": {"samples": Q, "radius": 0.2, "density": None},
        "WeightedInverse": {"task": task, "weight": [1.0, 2.0, 3.0]},
        "WorkspaceBox": {
            "task": task, "position": middle, "half_width": 0.2, "within": box, "density": None,
        },
    }  # fmt: skip
    J, N = task.jacobian(q0), rp.redundancy.nullspace(task.jacobian(q0))
    V, G = inverse.potentials.gradient(q0), control(q0)
    formulas: dict[str, dict[str, Any]] = {
        "align": {"N": N, "reference": N},
        "augmented_inverse": {"J": J, "V": V},
        "from_null_component": {"J": J, "N": N, "W": G.T @ N},
        "leaf_margin": {"N": N, "V": V},
        "null_component": {"G": G, "N": N},
        "null_vector": {"J": J},
        "nullspace": {"J": J},
        "pseudoinverse": {"J": J},
        "pseudoinverse_derivative": {"J": J, "H": task.hessian(q0)},
        "repeatable_inverse": {"G_d": G, "N": N, "V": V},
        "weighted_pseudoinverse": {"J": J, "M": np.eye(3)},
    }
    step = {"q": q0, "target": target, "dt": 0.01, "twist": np.zeros(6), "leaf": inverse.leaf(q0),
    "gain": 10.0,
            "velocity_limit": 3.0, "damping": 0.01}  # fmt: skip
    near_elbow = {"elbow": [0.3, 0.5, 0.0], "link": "tool", "margin": 0.0}
    methods: dict[str, dict[str, Any]] = {
        "__call__": {"q": q0},
        "as_dict": {},
        "axes": {"q": q0},
        "batch": {"Q": Q, "J": task.jacobians(Q)},
        "between": {"lower": q0 - 0.1, "upper": q0 + 0.1, "density": None},
        "chain": {"frame": "tool"},
        "check": {"q": q0, "what": "q"},
        "clip": {"Q": Q},
        "contains": {"Q": Q},
        "cycle": {"k": 1},
        "elbow": {"q": q0, "link": "tool"},
        "error": {"q": q0, "target": target},
        "errors": {"Q": Q, "targets": [target] * len(Q)},
        "to_robot": {"q": q0},
        "gradients": {"Q": Q},
        "hessian": {"q": q0},
        "hessians": {"Q": Q},
        "inertias": {"Q": Q},
        "inside": {"lower": task.lower, "upper": task.upper},
        "jacobian": {"q": q0},
        "jacobians": {"Q": Q},
        "twists": {"Q": Q, "Qdot": Q},
        "joint_origins": {"q": q0},
        "leaf": {"q": q0},
        "limit_margin": {"q": q0},
        "slowed": {"factor": 2.0},
        "thinned": {"most": 5},
        "load": {"name_or_path": "planar3r", "package_dirs": (), "lock": ("theta1",), "base": None},
        "nodes": {"count": 8, "seed": 0},
        "from_robot": {"whole": q0},
        "placement": {"q": q0},
        "placements": {"q": q0},
        "as_target": {"value": target},
        "points": {"count": 5},
        "positions": {"Q": Q},
        "values": {"Q": Q},
        "random": {"count": 8, "seed": 0},
        "task_velocity": {"q": q0, "twist": np.zeros(6)},
        "ratio": {"Q": Q},
        "reference_positions": {},
        "retimed": {"limit": 1.0},
        "row": {"key": "pseudoinverse"},
        "save": {"file": folder / "page.html"},
        "shrunk": {"factor": 0.5},
        "solve": {"target": target, "q0": q0, "leaf": inverse.leaf(q0)},
        "same_leaf": {"q": q0, "other": q0},
        "step": step,
        "damped_step": step,
        "summary": {},
        "task": {"frame": "tool", "kind": "xy", "joints": list(robot.joint_names)},
        "twist": {"s": 0.3},
        "velocities": {"Q": Q, "Xdot": Xdot},
        "velocity": {"q": q0, "xdot": np.ones(2)},
        "weights": {"Q": Q},
    }  # fmt: skip
    U, R, p = cell.sample(4), np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3))
    Q_arm = arm.reference + np.array([[0.1, 0.2, 0.3, 0.1, 0.2], [0.2, 0.1, 0.4, 0.3, 0.1]])
    own: dict[tuple[type, str], dict[str, Any]] = {
        (rp.Cell, "around"): {"task": task, "poses": [target], "margin": 0.02, "half_angle": 0.0},
        (rp.Cell, "at"): {"u": U[0]},
        (rp.Run, "step"): {"dt": 0.01, "override": 0.5},
        (rp.Governor, "start"): {"q": q0},
        (rp.Governor, "keeps_distance"): {"Q": q0[None]},
        (rp.Clutch, "engage"): {"hand": target, "at": target},
        (rp.Clutch, "target"): {"hand": target},
        (rp.Clutch, "elbow"): {"elbow": [0.3, 0.5, 0.0]},
        (rp.Clutch, "release"): {},
        (rp.Governor, "step"): {"target": target},
        (rp.Design, "evaluate_baselines"): {"progress": False},
        (rp.Design, "spectral_cost"): {},
        (rp.Cell, "coordinates"): {"p": p, "R": R},
        (rp.Cell, "coordinates_of"): {"target": target},
        (rp.Cell, "errors"): {"p_goal": p, "R_goal": R, "p": p, "R": R},
        (rp.Cell, "inside"): {"U": U, "off": np.zeros(4)},
        (rp.Cell, "placements"): {"U": U},
        (rp.Cell, "sample"): {"count": 8, "seed": 0},
        (rp.Cell, "scaled"): {"factor": 0.5},
        (rp.Cell, "slopes"): {"p": p, "R": R},
        (rp.Cell, "speeds"): {"U": U},
        (rp.Cell, "spread"): {"U": U},
        (rp.Cell, "twists"): {"U": U, "R": R},
        (rp.Cell, "vectors"): {"turns": p[:, :2]},
        (rp.Cell, "where"): {"u": U[0]},
        (rp.InverseFunction, "__call__"): {"target": target, "leaf": [0.0]},
        (rp.InverseFunction, "batch"): {"targets": [target], "leaf": [0.0], "missing": "nan"},
        (rp.InverseFunction, "pose_and_leaf"): {"Q": Q},
        (rp.InverseFunction, "jacobian"): {"target": target, "leaf": [0.0]},
        (rp.InverseFunction, "leaf_toward"): {"target": target, **near_elbow},
        (rp.InverseFunction, "leaves"): {"target": target},
        (rp.RepeatableInverse, "leaf_toward"): {"q": q0, **near_elbow},
        (rp.MotionBetween, "at"): {"t": [0.1, 0.2]},
        (rp.MotionBetween, "cycle"): {"k": 0},
        (rp.Viewer, "show"): {"configurations": q0, "before": [q0], "out_of_reach": False},
        (rp.Bodies, "nearest"): {"q": Q_arm[0]},
        (rp.Bodies, "distances"): {"Q": Q_arm},
        (rp.Bodies, "hull_distances"): {"Q": Q_arm},
        (rp.ArmAngle, "distance"): {"q": Q_arm[0]},
        (rp.ArmAngle, "gradients"): {"Q": Q_arm},
        (rp.ArmAngle, "values"): {"Q": Q_arm},
        (rp.LeafImpedance, "torque"): {
            "q": q0,
            "qdot": np.zeros(3),
            "target": target,
            "twist": np.zeros(6),
            "leaf": inverse.leaf(q0),
            "observer": rp.LeafImpedance(inverse).observer(0.001),
        },
        (rp.LeafImpedance, "observer"): {"dt": 0.001},
        (rp.Tube, "nearest"): {"Q": Q[:2]},
        (rp.TaskPath, "placement"): {"s": 0.3},
        (rp.Recording, "read"): {"file": frames_file, "task": task},
        (rp.Relabeled, "save"): {"file": folder / "again.npz"},
    }
    things = [
        cell, found, found.function, found.inverse, rp.Bodies(arm), angle, rp.Clutch(),
        viewer, recording, relabeled,
        rp.LeafImpedance(inverse), robot, task,
        control, rp.WeightedInverse(task, [1, 2, 3]), rp.PostureControl(task, q0), inverse,
        rp.CustomInverse(task, control), rp.ExtendedJacobian(task, q0), rp.LimitWeight(task),
        potentials, waves, joined,
        custom, box, tube, workspace, design, motion, study, path, rp.Run(timed), started,
        rp.audit((motion.t, motion.q), task),
        rp.motion_between(found.function, between, limits),
        rp.best_leaf(inverse, path, q0, steps=8), rp.animation({"J⁺": motion}, seconds=1.0),
    ]  # fmt: skip
    public = {n for n in dir(rp) if callable(getattr(rp, n)) and not n.endswith("Error")}
    assert public - RESULTS - MADE == set(functions), "give each public name a right call here"
    calls = [Call(name, getattr(rp, name), good) for name, good in functions.items()]
    calls += [
        Call(f"redundancy.{name}", getattr(rp.redundancy, name), good)
        for name, good in formulas.items()
    ]
    for thing in things:
        for name in public_methods(type(thing)):
            good = next(
                (own[kind, name] for kind in type(thing).__mro__ if (kind, name) in own),
                methods.get(name),
            )
            if name in ("weighted", "split"):
                good = {"A": np.ones((thing.size, 1))}
            elif name in ("figures", "corners", "rim", "size", "close"):
                good = {}
            elif good is None and name in (
                "show",
                "open",
                "of",
                "dynamics",
                "bodies_model",
                "target_type",
                "with_tool",
            ):
                continue  # the first serves until it is stopped, the last is for pose tasks
            assert good is not None, f"give {type(thing).__name__}.{name} a right call here"
            if thing is found.inverse and "leaf" in good:
                good = good | {"leaf": thing.leaf(q0)}
            if good:
                calls.append(Call(f"{type(thing).__name__}.{name}", getattr(thing, name), good))
    return calls


def public_methods(kind: type) -> list[str]:
    """Name a class's public methods."""
    names = [name for name in dir(kind) if name == "__call__" or not name.startswith("_")]
    return [name for name in names if callable(getattr(kind, name))]


def broken(*_: Any) -> Any:
    """A function that fails."""
    raise RuntimeError("a person's own function fails")


NONSENSE: list[tuple[str, Any]] = [
    ("an object", object()),
    ("a class", dict),
    ("NaN", float("nan")),
    ("text", "wörds"),
    ("bytes", b"abc"),
    ("a set", {1, 2}),
    ("a complex number", 1j),
    ("a dictionary of rubbish", {"a": None}),
    ("a list of None", [None, None, None]),
    ("a ragged list", [[1.0], [1.0, 2.0]]),
    ("an array of NaN", np.full(3, np.nan)),
    ("an array of text", np.array(["a", "b", "c"])),
    ("an array of objects", np.array([object()] * 3)),
    ("a module", np),
]
"""What is right for nothing at the door (text is, where text is taken)."""

ODD: list[tuple[str, Any]] = [
    ("None", None),
    ("infinity", float("inf")),
    ("-infinity", float("-inf")),
    ("-1", -1),
    ("-0.5", -0.5),
    ("0", 0),
    ("True", True),
    ("1e308", 1e308),
    ("1e-308", 1e-308),
    ("1e9", 10**9),
    ("1e19", 10**19),
    ("2 ** 63", 2**63),
    ("1e400", 10**400),
    ("3", 3),
    ("'3'", "3"),
    ("no text", ""),
    ("a NUL", "\0"),
    ("a line break", "a\nb"),
    ("long text", "x" * 5000),
    ("no list", []),
    ("an empty dictionary", {}),
    ("an empty array", np.zeros((0, 3))),
    ("two numbers", [0.1, 0.2]),
    ("three numbers", [0.1, 0.2, 0.3]),
    ("a column", np.zeros((3, 1))),
    ("zeros", np.zeros((2, 3))),
    ("a cube", np.zeros((2, 3, 4))),
    ("numbers of 1e308", np.full(3, 1e308)),
    ("numbers of 1e200", np.full((2, 3), 1e200)),
    ("integers", np.arange(3)),
    ("a failing function", broken),
    ("a function of nothing", lambda: None),
    ("a function to None", lambda *_: None),
    ("a function to NaN", lambda *_: np.nan),
    ("a path", Path("nowhere/there")),
    ("an SE3", pin.SE3.Identity()),
    ("an SE3 of NaN", pin.SE3(np.eye(3), np.full(3, np.nan))),
]
"""What may be right here or there."""


def spoilt(good: Any) -> list[tuple[str, Any]]:
    """Spoil a right value in ways of its own kind."""
    if (
        isinstance(good, bool)
        or good is None
        or not isinstance(good, (int, float, list, tuple, np.ndarray))
    ):
        return []
    if isinstance(good, (int, float)):
        return [("negative", -good if good else -3), ("half", good + 0.5), ("huge", good + 10**12)]
    try:
        array = np.asarray(good)
    except ValueError:  # a list of things that are no numbers
        return [("its first", good[0])]
    if array.dtype.kind not in "fiu" or not array.size:
        return [("its first", good[0])] if len(good) else []
    array = array.astype(float)
    hole = array.copy()
    hole.flat[-1] = np.nan
    pole = array.copy()
    pole.flat[0] = np.inf
    return [
        ("with a NaN", hole),
        ("with an infinity", pole),
        ("one short", array[..., :-1]),
        ("twice", np.concatenate([array, array], axis=-1)),
        ("one more axis", array[None]),
        ("flat", array.ravel()),
        ("as text", array.astype(str)),
        ("big-endian", array.astype(">f8")),
        ("whole numbers", np.rint(array).astype(int)),
        ("negative", -array),
        ("times 1e300", array * 1e300),
    ]


class Hung(BaseException):
    """A call took too long."""


@contextmanager
def patience(seconds: float) -> Iterator[None]:
    """Raise :class:`Hung` in here after so many seconds."""

    def stop(*_: Any) -> None:
        raise Hung

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def outcome(call: Call, wrong: dict[str, Any]) -> str:
    """Make a call with some of its arguments wrong: ``taken``, ``refused``, or what went wrong with
    that."""
    given = call.good | wrong
    parameters = inspect.signature(call.function).parameters.values()
    stars = [p.name for p in parameters if p.kind is inspect.Parameter.VAR_POSITIONAL]
    first = [
        given.pop(p.name)
        for p in parameters
        if stars and p.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
    ]
    first += [given.pop(name) for name in stars]
    try:
        with patience(PATIENCE), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            partial(call.function, *first)(**given)
    except Hung:
        return "hung"
    except rp.RepctlError as error:
        text = str(error)
        if not text.isprintable() or len(text) > 800 + 3:
            return f"refused in no single short line: {text[:200]!r}"
        return "refused"
    except RecursionError:
        return "raw RecursionError"
    except Exception as error:
        if wrong_function(wrong.values(), error):
            return "refused"
        return f"raw {type(error).__name__}: {' '.join(str(error).split())[:140]}"
    return "taken"


def wrong_function(values: Any, error: Exception) -> bool:
    """A person's own function may fail in its own way: its own traceback is the best that can be
    had."""
    return (
        isinstance(error, RuntimeError) and "own function fails" in str(error) and broken in values
    )


def all_wrong(calls: list[Call]) -> list[tuple[Call, str, str, Any]]:
    """Every call with each of its arguments wrong in every way, one at a time."""
    return [
        (call, name, what, value)
        for call in calls
        for name, good in call.good.items()
        for what, value in [*NONSENSE, *ODD, *spoilt(good)]
    ]


def main() -> None:
    """Try at random, one argument or two at a time, and print what was not refused by name."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--only", default="", help="calls whose name holds this")
    parser.add_argument("--taken", action="store_true", help="print nonsense that was taken, too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        calls = [call for call in right_calls(Path(folder)) if options.only in call.name]
        tries = all_wrong(calls)
        rng = np.random.default_rng(options.seed)
        order = rng.permutation(len(tries))[: options.count]
        counts: Counter[str] = Counter()
        for i in order:
            call, name, what, value = tries[i]
            came = outcome(call, {name: value})
            counts[came.split(":")[0].split(" ")[0]] += 1
            shout = came not in ("refused", "taken")
            if shout or (
                options.taken and came == "taken" and any(value is v for _, v in NONSENSE)
            ):
                print(f"{call.name}({name} = {what}): {came}", flush=True)
        print(dict(counts), "of", len(order), "(all:", len(tries), ")", file=sys.stderr)


if __name__ == "__main__":
    main()
