"""Results are compared by identity, their arrays are read-only, and their repr is words."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import pkgutil
import re
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from controls import in_numpy
from store import study_of

import repctl_pin as rp


def holds_arrays(kind: type) -> bool:
    types = [str(field.type) for field in dataclasses.fields(kind)]
    return any(
        re.search(r"\b(Array|NDArray|ndarray|Index)\b", text) and not text.startswith("Callable")
        for text in types
    )


def dataclasses_with_arrays() -> list[Any]:
    """Every dataclass of the package that holds an array."""
    found = {}
    for module in pkgutil.walk_packages(rp.__path__, "repctl_pin."):
        if ".integrations" in module.name or "__main__" in module.name:
            continue
        for name, kind in vars(import_module(module.name)).items():
            own = inspect.isclass(kind) and kind.__module__ == module.name
            if own and dataclasses.is_dataclass(kind) and holds_arrays(kind):
                found[f"{module.name}.{name}"] = kind
    return list(found.values())


KINDS = dataclasses_with_arrays()


def test_there_are_many() -> None:
    assert len(KINDS) > 50


def test_dataclasses_with_arrays_are_compared_by_identity_and_read_only() -> None:
    for kind in KINDS:
        assert kind.__dataclass_params__.frozen, kind
        assert kind.__eq__ is object.__eq__, kind
        assert kind.__hash__ is object.__hash__, kind
        one = kind.__new__(kind)
        one.__setstate__({"some": np.zeros(2)})
        assert not one.some.flags.writeable, kind
        if kind.__dataclass_params__.init:
            assert kind.__post_init__.__module__ == "repctl_pin.base.arguments", kind


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    """Small results of every kind at the door."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    control = rp.Pseudoinverse(task)
    box = rp.Box(q0, 0.4)
    options = rp.FitOptions(samples=256, held_out=64)
    design = rp.nearest_repeatable(control, None, box, degree=1, options=options)
    path = rp.circle(task, q0, 0.1)
    motion = rp.follow(design.inverse, path, q0, cycles=2, steps=24)
    cell = rp.Cell(task, task.placement(q0), 0.1)
    few = rp.FitOptions(samples=64, held_out=64)
    return {
        "box": box,
        "tube": rp.Tube([q0], 0.1),
        "workspace": rp.WorkspaceBox(task, task.placement(q0).translation[:2], 0.2, within=box),
        "design": design,
        "path": path,
        "motion": motion,
        "timed": rp.timed(motion, rp.Limits(acceleration=10.0)),
        "cell": cell,
        "function": rp.nearest_inverse_function(control, cell, degree=1, options=few),
        "recording": (
            recording := rp.Recording(task, joints=q0 + np.linspace(0, 0.1, 90)[:, None])
        ),
        "relabeled": rp.relabel(recording, options=few),
        "best": rp.best_leaf(design.inverse, path, q0, steps=8),
        "repeatable": rp.is_repeatable(control, box, samples=8),
        "surfaces": rp.stable_surface(control, box, samples=8),
        "step": design.inverse.damped_step(q0, path.placement(0.0), 0.01),
        "audit": rp.audit((motion.t, motion.q), task),
        "study": study_of("planar3r", 2, 100),
    }


NAMES = [
    "box",
    "tube",
    "workspace",
    "design",
    "path",
    "motion",
    "timed",
    "cell",
    "function",
    "recording",
    "relabeled",
    "best",
    "repeatable",
    "surfaces",
    "step",
    "audit",
    "study",
]


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_equal_to_itself_only(results: dict[str, Any], name: str) -> None:
    one = results[name]
    assert one == one and one in [one] and {one: 1}[one] == 1
    if not isinstance(one, rp.TaskPath):  # which copies to itself
        other = copy.copy(one)
        assert other != one and other not in [one]


@pytest.mark.parametrize("name", NAMES)
def test_the_arrays_of_a_result_are_read_only_in_copies_too(
    results: dict[str, Any], name: str
) -> None:
    one = results[name]
    for result in (one, copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        for key, value in vars(result).items():
            if isinstance(value, np.ndarray):
                with pytest.raises(ValueError, match="read-only"):
                    value[...] = 0
                assert np.array_equal(value.astype(str), getattr(one, key).astype(str))


def test_a_saved_design_agrees_with_its_control(results: dict[str, Any], tmp_path: Any) -> None:
    design = results["design"]
    with pytest.raises(ValueError, match="read-only"):
        design.coefficients[:] = 0
    again = rp.load_design(rp.save(design, tmp_path / "d.json"), design.task)
    assert np.array_equal(again.inverse(design.region.center), design.inverse(design.region.center))


def test_distances_of_a_motion_are_computed_once_and_read_only(results: dict[str, Any]) -> None:
    motion = results["motion"]
    assert motion.body_distance is motion.body_distance
    with pytest.raises(ValueError, match="read-only"):
        motion.body_distance[:] = 0
    with pytest.raises(ValueError, match="read-only"):
        motion.q[:] = 0


def test_an_array_that_is_given_stays_writable() -> None:
    center, samples = np.zeros(3), np.zeros((1, 3))
    rp.Box(center, 0.1), rp.Tube(samples, 0.1)
    center[:], samples[:] = 1, 1


@pytest.mark.parametrize("name", [name for name in NAMES if name != "step"])
def test_results_print_in_words(results: dict[str, Any], name: str) -> None:
    text = repr(results[name])
    assert text.startswith("<") and text.endswith(">")
    assert "array(" not in text and " object at 0x" not in text and len(text) < 250


@pytest.mark.parametrize(
    "share, text",
    [
        (0.0, "0 %"),
        (1e-9, "< 0.1 %"),
        (0.0004999, "< 0.1 %"),
        (0.0006, "0.1 %"),
        (0.5, "50.0 %"),
        (0.9994, "99.9 %"),
        (0.99951, "> 99.9 %"),
        (1 - 1e-9, "> 99.9 %"),
        (1.0, "100 %"),
    ],
)
def test_no_share_is_rounded_to_all_or_nothing(
    results: dict[str, Any], share: float, text: str
) -> None:
    design = dataclasses.replace(results["design"], inside_limits=share)
    assert f"\n  inside the limits  {text} of Ω" in design.summary()


def test_every_class_at_the_door_has_a_repr() -> None:
    classes = [getattr(rp, name) for name in dir(rp) if inspect.isclass(getattr(rp, name))]
    assert [kind for kind in classes if kind.__repr__ is object.__repr__] == []


def test_strategies_print_in_words(results: dict[str, Any]) -> None:
    design = results["design"]
    task, q0 = design.task, design.region.center
    control = rp.Pseudoinverse(task)
    assert repr(control) == "<Pseudoinverse of planar3r tool xy>"
    assert repr(design.inverse) == "<RepeatableInverse of planar3r tool xy: 1 potential>"
    assert (
        repr(rp.PostureControl(task, q0, 2)) == "<PostureControl of planar3r tool xy: gain 2 1/s>"
    )
    assert repr(rp.WeightedInverse(task, [1, 2, 3])).endswith("tool xy: constant M>")
    assert repr(rp.WeightedInverse(task, rp.LimitWeight(task))).endswith("weight a function of q>")
    assert repr(rp.CustomInverse(task, control)) == "<CustomInverse of planar3r tool xy>"
    assert repr(rp.LimitWeight(task)) == "<LimitWeight of 3 joints: gain 1, onset 0.1>"


def test_a_step_is_reported_as_a_value(results: dict[str, Any]) -> None:
    design = results["design"]
    q0, control = design.region.center, design.inverse
    target = design.task.placement(q0 + 0.1)
    for one in (control, in_numpy(control)):
        free, slow = (
            one.damped_step(q0, target, 0.01),
            one.damped_step(q0, target, 0.01, velocity_limit=0.5),
        )
        assert np.array_equal(free.q, one.step(q0, target, 0.01))
        assert (free.damping, free.slowed) == (0.0, 1.0)
        assert slow.slowed < 1 and np.array_equal(
            slow.q, one.step(q0, target, 0.01, velocity_limit=0.5)
        )
        assert not hasattr(one, "damping") and not hasattr(one, "slowed")


def test_a_target_is_an_SE3_or_a_matrix(results: dict[str, Any]) -> None:
    design, F = results["design"], results["function"].function
    q0, control = design.region.center, design.inverse
    x = design.task.placement(q0 + 0.01)
    T = x.homogeneous
    path = [x.homogeneous, design.task.placement(q0).homogeneous, x.homogeneous]
    for one in (control, in_numpy(control)):
        assert np.array_equal(one.step(q0, T.tolist(), 0.01), one.step(q0, x, 0.01))
    assert np.array_equal(F(T), F(x))
    assert np.array_equal(F.batch(T[None]), F.batch([x]))
    assert np.array_equal(control.solve(T, q0), control.solve(x, q0))
    assert np.array_equal(rp.solve_ik(design.task, q0, T), rp.solve_ik(design.task, q0, x))
    assert np.array_equal(design.task.error(q0, T), design.task.error(q0, x))
    assert np.array_equal(F.leaves(T), F.leaves(x))
    assert np.array_equal(F.cell.coordinates_of(T), F.cell.coordinates_of(x))
    assert rp.Cell.around(design.task, np.array(path)).k == 2
    moved = rp.waypoints(np.array([*path[:2], design.task.placement(q0 - 0.05).homogeneous, T]))
    assert np.allclose(moved.placement(0.0).homogeneous, T)
