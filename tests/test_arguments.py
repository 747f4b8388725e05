"""Arguments of the wrong kind, size or value: one line that names the argument and says what to
give."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp
from repctl_pin.paths import rose

A_TASK, AN_INVERSE = (
    r"task must be a task, such as rp\.",
    r"must be an inverse .* such as rp\.Pseudoinverse\(task\)",
)
A_BOX, A_PATH = (
    r"region must be .* such as rp\.Box\(q0",
    r"path must be a closed path, such as rp\.circle\(task, q0\)",
)


class Given:
    """What the calls below are made with: all of it is right but for one argument."""

    def __init__(self, task: rp.Task) -> None:
        self.task, self.q0 = task, np.array(task.reference)
        self.control, self.box = rp.Pseudoinverse(task), rp.Box(self.q0, 0.3)
        self.path = rp.circle(task, self.q0, 0.1, normal="x")
        self.potentials = rp.Polynomial(self.q0, 2, 0.3)
        self.waves = rp.Fourier(7, 1)
        self.tube = rp.Tube([self.q0], 0.3)

    def own(self, q: np.ndarray, xdot: np.ndarray) -> np.ndarray:
        """A control of one's own, as a plain function."""
        return self.control.velocity(q, xdot)


@pytest.fixture(scope="module")
def given(panda_pose: rp.Task) -> Given:
    return Given(panda_pose)


SHORT = np.zeros((2, 3))
CALLS: dict[str, tuple[Callable[[Given], object], str]] = {
    "follow, a path in words": (
        lambda g: rp.follow(g.control, "circle:0.1", g.q0),
        A_PATH + "; got 'circle:0.1'",
    ),
    "follow, a task in words": (
        lambda g: rp.follow(g.own, g.path, g.q0, task="pose"),
        A_TASK + ".*'pose'",
    ),
    "follow, a control in words": (
        lambda g: rp.follow("panda", g.path, g.q0, task=g.task),
        r"strategy must be a controller, such as .*'panda'",
    ),
    "follow, cycles": (
        lambda g: rp.follow(g.control, g.path, g.q0, cycles="ten"),
        "cycles must be a whole .*'ten'",
    ),
    "follow, steps": (
        lambda g: rp.follow(g.control, g.path, g.q0, steps=np.nan),
        "steps must be a whole .* not nan",
    ),
    "follow, period": (
        lambda g: rp.follow(g.control, g.path, g.q0, period="5 s"),
        "period must be above 0 s",
    ),
    "follow, feedback": (
        lambda g: rp.follow(g.control, g.path, g.q0, feedback=None),
        "gain must be 0 or more",
    ),
    "best_leaf, inverse": (
        lambda g: rp.best_leaf(g.control, g.path, g.q0),
        "inverse must be a repeatable inverse",
    ),
    "RepeatableInverse, potentials of other joints": (
        lambda g: rp.RepeatableInverse(
            g.task, rp.Polynomial(np.zeros(3), 1).weighted(np.ones((3, 1)))
        ),
        "the potentials are functions of 3 joints, but the task has 7",
    ),
    "RepeatableInverse, waves of other joints": (
        lambda g: rp.RepeatableInverse(g.task, rp.Fourier(3, 1).weighted(np.ones((6, 1)))),
        "of 3 joints, .* has 7",
    ),
    "RepeatableInverse, some of other joints": (
        lambda g: rp.RepeatableInverse(
            g.task,
            (rp.CustomPotentials([lambda q: q[0]]) + rp.Fourier(9, 1, variables=[0])).weighted(
                np.ones((3, 1))
            ),
        ),
        "of 9 joints, .* has 7",
    ),
    "nearest_repeatable, potentials of other joints": (
        lambda g: rp.nearest_repeatable(g.control, rp.Fourier(9, 1, variables=[0]), g.box),
        "of 9 joints, .* has 7",
    ),
    "study, a region no double holds": (
        lambda g: rp.study(rp.Problem("planar3r", region=10**400)),
        "region.* must be above 0 rad",
    ),
    "WeightedInverse, a weight no double holds": (
        lambda g: rp.WeightedInverse(g.task, [10**400] + 6 * [1]),
        "weight must be 7 numbers",
    ),
    "waypoints, out of reach": (
        lambda g: rp.waypoints(1e300 * np.array([[0, 0, 1], [0, 1, 1], [0, 0, 1]]), np.eye(3)),
        "waypoints: a coordinate of 1e\\+300 m",
    ),
    "TaskPath, a point of nothing": (
        lambda g: rp.TaskPath("path", lambda: np.zeros(3), lambda s: np.zeros(3), np.eye(3)),
        "point must be a function of s",
    ),
    "save, a name no folder takes": (lambda g: rp.save(g.control, 5000 * "x"), "^.{1,803}$"),
    "study, a path of numbers": (
        lambda g: rp.study(rp.Problem("planar3r", path=np.zeros(3))),
        "path must be",
    ),
    "limit_margin, text": (lambda g: g.task.limit_margin("home"), "q must be .* 7"),
    "limit_margin, one short": (lambda g: g.task.limit_margin(g.q0[:-1]), "q must be .* 7"),
    "slowed, a row": (
        lambda g: rp.follow(g.control, g.path, g.q0, cycles=1, steps=8).slowed(np.ones(3)),
        "the factor must be above 0",
    ),
    "Joined, other joints": (
        lambda g: g.potentials + rp.Fourier(9, 1, variables=[0]),
        "potentials of 7 and of 9 joints cannot be joined",
    ),
    "ExtendedJacobian, a joint that is not there": (
        lambda g: rp.ExtendedJacobian(g.task, lambda q: q[8])(g.q0),
        "potential U must be one .* index 8 is out of bounds",
    ),
    "reach, task": (lambda g: rp.solve_ik("panda", g.q0, pin.SE3.Identity()), A_TASK),
    "reach, target": (
        lambda g: rp.solve_ik(g.task, g.q0, [0.3, 0, 0.5]),
        "target must be a placement",
    ),
    "reach, q0": (
        lambda g: rp.solve_ik(g.task, "home", pin.SE3.Identity()),
        "q0 must be 7 finite numbers.*'home'",
    ),
    "is_repeatable, a function": (
        lambda g: rp.is_repeatable(g.own, g.box),
        AN_INVERSE + ".*CustomInverse.*function q",
    ),
    "is_repeatable, a number": (lambda g: rp.is_repeatable(g.control, 0.3), A_BOX + ".*got 0.3"),
    "is_repeatable, samples": (
        lambda g: rp.is_repeatable(g.control, g.box, samples="all"),
        "samples must be a whole",
    ),
    "stable_surface, a function": (lambda g: rp.stable_surface(g.own, g.box), AN_INVERSE),
    "stable_surface, a number": (lambda g: rp.stable_surface(g.control, 0.3), A_BOX),
    "bracket_defect, a function": (lambda g: rp.bracket_defect(g.own, g.q0), AN_INVERSE),
    "bracket_defect, q": (
        lambda g: rp.bracket_defect(g.control, "home"),
        "q must be 7 finite numbers.*'home'",
    ),
    "drift_per_area, a function": (lambda g: rp.drift_per_area(g.own, g.q0), AN_INVERSE),
    "drift_per_area, nan": (
        lambda g: rp.drift_per_area(g.control, np.full(7, np.nan)),
        "q must be 7 finite numbers",
    ),
    "nearest, desired": (
        lambda g: rp.nearest_repeatable("panda", g.potentials, g.box),
        "desired " + AN_INVERSE,
    ),
    "nearest, no inverse": (
        lambda g: rp.nearest_repeatable(rp.PostureControl(g.task, g.q0), g.potentials, g.box),
        "desired " + AN_INVERSE + ".*PostureControl",
    ),
    "nearest, potentials": (
        lambda g: rp.nearest_repeatable(g.control, "quadratic", g.box),
        r"potentials must be a basis of potentials, such as rp\.Polynomial",
    ),
    "nearest, region": (lambda g: rp.nearest_repeatable(g.control, g.potentials, 0.3), A_BOX),
    "circle, task": (lambda g: rp.circle("panda", g.q0), A_TASK + ".*'panda'"),
    "circle, radius": (
        lambda g: rp.circle(g.task, g.q0, radius="a"),
        "radius of a path must be above 0 m, not 'a'",
    ),
    "circle, normal": (lambda g: rp.circle(g.task, g.q0, normal=3), "normal must be an axis"),
    "circle, q0": (
        lambda g: rp.circle(g.task, "home"),
        "q of <Task panda .* must be 7 finite numbers",
    ),
    "rose, petals": (lambda g: rose(g.task, g.q0, petals="three"), "petals must be a whole number"),
    "polygon, task": (lambda g: rp.polygon("panda", g.q0, [[0, 0, 1], [0, 1, 1]]), A_TASK),
    "J⁺": (lambda g: rp.Pseudoinverse("panda"), A_TASK),
    "J⁺, weighted": (lambda g: rp.WeightedInverse("panda", "inertia"), A_TASK),
    "posture": (lambda g: rp.PostureControl("panda", g.q0), A_TASK),
    "extended": (lambda g: rp.ExtendedJacobian("panda", g.q0), A_TASK),
    "of one's own": (lambda g: rp.CustomInverse("panda", g.control), A_TASK),
    "repeatable": (
        lambda g: rp.RepeatableInverse("panda", g.potentials.weighted(np.ones((35, 1)))),
        A_TASK,
    ),
    "limit weight": (lambda g: rp.LimitWeight("panda"), A_TASK),
    "absolute angles": (lambda g: rp.absolute_angles("planar3r"), A_TASK),
    "workspace box": (lambda g: rp.WorkspaceBox("panda", [0, 0, 0], 0.1, within=g.box), A_TASK),
    "box": (
        lambda g: g.box.contains(SHORT),
        r"this box takes Q as an array \(K, 7\).*shape \(2, 3\)",
    ),
    "box, one q": (lambda g: g.box.contains(g.q0), r"shape \(7,\); write \[q\]"),
    "box, words": (lambda g: g.box.ratio("q0"), r"\(K, 7\).*'q0'"),
    "box, clip": (lambda g: g.box.clip(SHORT), r"\(K, 7\)"),
    "box, limits": (lambda g: g.box.inside([0, 1], [2, 3]), "limits of this box must be 7 numbers"),
    "box, density": (
        lambda g: rp.Box(g.q0, 0.3, density=lambda Q: "much").nodes(64, 0),
        r"density .* returns K numbers",
    ),
    "tube": (lambda g: g.tube.contains(SHORT), r"this tube takes Q as an array \(K, 7\)"),
    "tube, ratio": (lambda g: g.tube.ratio(SHORT), r"\(K, 7\)"),
    "polynomial": (
        lambda g: g.potentials.values(SHORT),
        r"this polynomial basis takes Q .*\(K, 7\).*\(2, 3\)",
    ),
    "polynomial, slopes": (lambda g: g.potentials.gradients(g.q0), r"\(K, 7\).*write \[q\]"),
    "polynomial, nan": (lambda g: g.potentials.values(np.full((2, 7), np.nan)), "not finite"),
    "polynomial, weights": (
        lambda g: g.potentials.weighted(np.ones((3, 1))),
        r"coefficients .*\(35, r\); got .*\(3, 1\)",
    ),
    "polynomial, center": (
        lambda g: rp.Polynomial("home", 2),
        "center of a polynomial basis must be a list",
    ),
    "polynomial, degree": (
        lambda g: rp.Polynomial(g.q0, "two"),
        "degree .* must be a whole .*'two'",
    ),
    "polynomial, joints": (
        lambda g: rp.Polynomial(g.q0, 2, variables=["elbow"]),
        "indices of joints, from 0 to 6",
    ),
    "polynomial, half a joint": (
        lambda g: rp.Polynomial(g.q0, 2, variables=[0.5]),
        "indices of joints, from 0 to 6",
    ),
    "Fourier": (lambda g: g.waves.values(SHORT), r"this Fourier basis takes Q .*\(K, 7\)"),
    "Fourier, slopes": (lambda g: g.waves.gradients("q0"), r"\(K, 7\).*'q0'"),
    "Fourier, n": (lambda g: rp.Fourier("panda", 1), "number of joints must be a whole"),
    "Fourier, order": (lambda g: rp.Fourier(7, None), "order .* must be a whole"),
    "Fourier, weights": (
        lambda g: g.waves.weighted(np.ones((3, 1))),
        r"coefficients must be .* \(14, r\)",
    ),
    "joined": (lambda g: (g.potentials + g.waves).gradients(SHORT), r"\(K, 7\)"),
    "given": (
        lambda g: rp.CustomPotentials([lambda q: q[5]]).values(SHORT),
        "potential h_1 must be one finite number, but .* index 5 is out of bounds",
    ),
    "given, slope": (
        lambda g: rp.CustomPotentials([(sum, lambda q: q[5])]).gradients(SHORT),
        "gradient of potential sum",
    ),
    "given, one q": (
        lambda g: rp.CustomPotentials([sum]).values(g.q0),
        r"rows|\(K, n\).*write \[q\]",
    ),
    "task, nan": (
        lambda g: g.task.jacobian(np.full(7, np.nan)),
        "q of <Task panda .* must be 7 finite numbers",
    ),
    "task, one nan": (
        lambda g: g.task.placement(np.where(np.arange(7) == 3, np.nan, g.q0)),
        "not finite",
    ),
    "task, inf": (lambda g: g.task.placement(np.full(7, -np.inf)), "not finite"),
    "task, six": (
        lambda g: g.task.jacobian(g.q0[:6]),
        r"7 finite numbers, one per joint; got shape \(6,\)",
    ),
    "task, words": (
        lambda g: g.task.jacobian("home"),
        "7 finite numbers, one per joint; got 'home'",
    ),
    "task, rows of nan": (
        lambda g: g.task.jacobians(np.full((2, 7), np.nan)),
        "takes Q as .* not finite",
    ),
    "task, no rows": (lambda g: g.task.positions(g.q0), r"write \[q\] for a single q"),
}


@pytest.mark.parametrize("case", CALLS)
def test_a_wrong_argument_gets_one_line(given: Given, case: str) -> None:
    call, words = CALLS[case]
    with pytest.raises(rp.InputError, match=words) as error:
        call(given)
    assert str(error.value).isprintable() and len(str(error.value)) < 300


def test_large_numbers_are_still_numbers(given: Given) -> None:
    q = np.full(7, 1e200)  # its square is beyond what a double holds
    assert np.isfinite(given.task.jacobian(q)).all()


def test_a_path_of_ones_own_class_will_do(given: Given) -> None:
    class Still:
        """A path that stays where it is."""

        name, breaks = "still", ()

        def placement(self, s: float) -> pin.SE3:
            return given.task.placement(given.q0)

        def twist(self, s: float) -> np.ndarray:
            return np.zeros(6)

    motion = rp.follow(given.control, Still(), given.q0, cycles=1, steps=4)
    assert np.array_equal(motion.q, np.tile(given.q0, (5, 1)))


def test_every_function_at_the_door_says_what_it_returns() -> None:
    functions = [getattr(rp, name) for name in dir(rp) if inspect.isfunction(getattr(rp, name))]
    assert len(functions) > 15
    silent = [
        f.__name__ for f in functions if "\nReturns\n-------\n" not in (inspect.getdoc(f) or "")
    ]
    assert silent == []


def test_what_follow_says_of_a_motion_is_there(given: Given) -> None:
    said = (rp.follow.__doc__ or "").partition("Returns\n")[2].partition("Raises\n")[0]
    names = [word.removesuffix("()") for word in said.split("``")[1::2]]
    assert {"drift", "tracking_error", "speed", "limit_margin"} <= set(names)
    motion = rp.follow(given.control, given.path, given.q0, cycles=1, steps=20)
    for name in names:
        getattr(motion, name)
