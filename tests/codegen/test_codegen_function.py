"""A cell's inverse kinematic function in C: F of a pose, and the control whose leaf it is."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import CELLS, cell_of, chart_of, f_in_numpy, function_of, on_a_workpiece
from controls import NEEDS_C, in_numpy, own_cache, some  # noqa: F401
from test_codegen import AGREE, disagreement
from test_codegen_builds import BUILDS, STRICT, needed, run

import repctl_pin as rp


@pytest.mark.slow
@pytest.mark.parametrize("name", CELLS)
def test_an_optimising_compiler_has_no_warning(name: str, tmp_path: Path) -> None:
    """It follows values further, and saw F read what no turn of Newton's method had written."""
    needed("gcc")
    rp.export_c(function_of(name), tmp_path, "arm")
    run(["gcc", "-std=c99", "-O2", *STRICT, "-c", "arm.c"], tmp_path)


@pytest.mark.parametrize(
    "name", [*some(CELLS, "poses"), pytest.param("on a workpiece", marks=pytest.mark.slow)]
)
def test_f_in_c_is_f(name: str, tmp_path: Path) -> None:
    """Built strictly, check.c compares F in and beyond the cell, and all that any control has."""
    needed("gcc")
    function = on_a_workpiece() if name == "on a workpiece" else function_of(name)
    rp.export_c(function, tmp_path, "arm")
    vectors = (tmp_path / "test_vectors.h").read_text().partition("arm_function_vectors[")[2]
    assert vectors.count("ARM_OK") >= 12 and vectors.count("ARM_OUTSIDE") >= 2
    for compiler in BUILDS if name == "poses" else ["gcc"]:
        needed(compiler)
        run(
            [compiler, *BUILDS[compiler], *STRICT, "arm.c", "check.c", "-o", "check", "-lm"],
            tmp_path,
        )
        assert run(["./check"], tmp_path).startswith("48 vectors, 0 differences")
    wrong = (
        (tmp_path / "arm.c")
        .read_text()
        .replace("turn < 8 && left", "turn < 1")
        .replace("leaf, 12, 0.3", "leaf, 1, 0.3")
    )
    (tmp_path / "arm.c").write_text(wrong)
    run(["gcc", "-w", "arm.c", "check.c", "-o", "check", "-lm"], tmp_path)
    with pytest.raises(AssertionError, match="F returned"):
        run(["./check"], tmp_path)
    run(
        [
            "g++",
            "-std=c++17",
            *STRICT,
            "-fsyntax-only",
            "-x",
            "c++",
            "arm.hpp",
            "-Wno-pragma-once-outside-header",
        ],
        tmp_path,
    )


@NEEDS_C
@pytest.mark.parametrize("name", some(CELLS, "poses", "positions"))
def test_its_control_steps_as_pythons(name: str) -> None:
    function = function_of(name)
    worst, _ = disagreement(function.inverse, function(function.cell.placement), 24, spread=0.1)
    assert worst < AGREE


def row(values: Iterable[float]) -> str:
    """Doubles as a C initialiser."""
    return f"{{{', '.join(repr(float(value)) for value in values)}}}"


def pose(placement: pin.SE3) -> str:
    """A placement as an initialiser of ``arm_pose``."""
    return f"{{{row(placement.translation)}, {row(placement.rotation.ravel())}}}"


def targets(
    function: rp.InverseFunction, count: int
) -> Iterator[tuple[pin.SE3, np.ndarray | None]]:
    """Targets in and beyond a cell, on the function's own leaf and on others."""
    rng, cell = np.random.default_rng(3), function.cell
    for k in range(count):
        u = rng.uniform(-1.1, 1.1, cell.k) * (0.8 if k % 3 else 1.0)
        leaf = 0.05 * (k % 2) * rng.normal(size=function.task.r)
        yield cell.at(u), None if k % 3 == 0 else leaf


def words(question: Callable[[], object]) -> str:
    """What an InputError says."""
    with pytest.raises(rp.InputError) as caught:
        question()
    return str(caught.value)


def compare_f(function: rp.InverseFunction, count: int) -> tuple[float, int]:
    """The greatest difference between F in Python and in C in and beyond the cell, and how many are
    refused alike."""
    slow, worst, none = f_in_numpy(function), 0.0, 0
    for target, leaf in targets(function, count):
        try:
            q = slow(target, leaf=leaf)
        except rp.InputError as error:
            none += 1
            assert words(lambda target=target, leaf=leaf: function(target, leaf=leaf)) == str(error)
        else:
            worst = max(worst, float(np.abs(function(target, leaf=leaf) - q).max()))
    return worst, none


@NEEDS_C
@pytest.mark.parametrize("name", some(CELLS, "poses", "tool axes"))
def test_f_in_the_library_is_numpys(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    function = function_of(name)
    worst, none = compare_f(function, 60)
    assert worst < AGREE and none > 1
    slow, U = f_in_numpy(function), 0.8 * function.cell.sample(64)
    c = np.full(function.task.r, 0.03)
    poses = [function.cell.at(u) for u in U]
    expected, moved = (np.array([slow(x, leaf=leaf) for x in poses]) for leaf in (None, c))
    assert np.abs(slow.batch(U) - expected).max() < AGREE
    with monkeypatch.context() as patch:  # neither F nor its batch asks NumPy
        patch.setattr(rp.InverseFunction, "_law", None)
        for found in (
            function.batch(U),
            function.batch(poses),
            np.array([function(x) for x in poses]),
        ):
            assert np.abs(found - expected).max() < AGREE
        assert np.abs(function.batch(U, leaf=c) - moved).max() < AGREE
    middle = function.cell.placement
    assert np.abs(slow.jacobian(middle) - function.jacobian(middle)).max() < AGREE
    again = pickle.loads(pickle.dumps(function))
    assert np.array_equal(again(middle), function(middle))
    assert function.batch(U[:0]).shape == (0, function.task.n)


@NEEDS_C
def test_f_refuses_in_the_same_words_in_c_and_numpy() -> None:
    function = function_of("poses")
    middle, cell, slow = function.cell.placement, function.cell, f_in_numpy(function)
    nowhere, turned = (
        pin.SE3(np.eye(3), np.full(3, np.nan)),
        pin.SE3(np.full((3, 3), np.nan), np.zeros(3)),
    )
    for ask in (
        lambda one: one(nowhere),
        lambda one: one(turned),
        lambda one: one("there"),
        lambda one: one(middle, leaf=[np.nan]),
        lambda one: one(middle, leaf=[1.0, 2.0]),
        lambda one: one(middle, leaf=[50.0]),
        lambda one: one.batch([middle, cell.at([3.0] * cell.k)]),
        lambda one: one.batch(np.full((2, cell.k), 2 * np.pi / 0.3)),
        lambda one: one.batch(np.zeros((2, 9))),
        lambda one: one.batch([middle], leaf=[50.0]),
    ):
        said = [words(lambda one=one, ask=ask: ask(one)) for one in (function, slow)]
        assert said[0] == said[1] and "\n" not in said[0]


@pytest.mark.parametrize("name", some(CELLS, "poses"))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_bad_number_is_named_by_the_control_of_a_cell(name: str, bad: float) -> None:
    """The logarithm of a rotation that is no number is none; it is not numpy's LinAlgError."""
    function = function_of(name)
    inverse, task, middle = function.inverse, function.task, function.cell.placement
    q = np.append(bad, np.zeros(task.n - 1))
    assert "q must be 7 finite numbers" in words(lambda: inverse.velocity(q, np.ones(task.m)))
    for options in ({}, {"damping": 0.1}):
        assert "q must be 7 finite numbers" in words(
            lambda options=options: inverse.step(q, middle, 0.01, **options)
        )


@NEEDS_C
@pytest.mark.slow
@pytest.mark.parametrize("name", CELLS)
def test_f_and_its_control_agree_at_10000(name: str) -> None:
    function = function_of(name)
    worst, none = compare_f(function, 10_000)
    steps, refused = disagreement(
        function.inverse, function(function.cell.placement), 10_000, spread=0.1
    )
    print(f"{name}: F {worst:.1e}, {none} refused; its control {steps:.1e}, {refused} refused")
    assert max(worst, steps) < AGREE


LEAVES = """
#include "arm.h"
#include <stdio.h>
int main(void)
{
    const double leaf[4][ARM_R] = @leaves;
    const arm_pose middle = @middle;
    double q[ARM_N];
    int k;
    for (k = 0; k < 4; k++) printf("%d ", (int)arm_F(&middle, leaf[k], q));
    for (k = 0; k < 4; k++) printf("%ld ", arm_F_batch(1, &middle, leaf[k], q));
    return 0;
}
"""


@pytest.mark.slow
def test_exported_f_checks_limits_on_every_leaf_but_the_evaluated_one(tmp_path: Path) -> None:
    """Issue 37, item 1: limits that c = 0 needs no check of were written as infinite for all."""
    needed("gcc")
    function = function_of("poses of one orientation")
    leaves = np.array([[0.0], [0.1], [-0.1], [5.0]])
    U = np.zeros((4, function.cell.k))
    q = function.chart.solve(U, leaves).Q
    inside = function.task.limit_margin(q).min(axis=1) >= 0
    assert np.array_equal(inside, [True, True, True, False])
    free = rp.InverseFunction(function.chart, keep_limits=False)
    rp.export_c(free, tmp_path, "arm")
    parts = {
        "leaves": f"{{{', '.join(map(row, leaves))}}}",
        "middle": pose(function.cell.placement),
    }
    code = re.sub("@([a-z]+)", lambda a: parts[a[1]], LEAVES)
    (tmp_path / "leaves.c").write_text(code)
    run(["gcc", "-O0", "arm.c", "leaves.c", "-o", "leaves", "-lm"], tmp_path)
    assert run(["./leaves"], tmp_path).split() == list("00031110")


KNOWS = """
#include "arm.h"
#include <stdio.h>
static void step(const double q[ARM_N], const arm_pose *target, const double *c,
                 const arm_options *options)
{
    double next[ARM_N];
    printf("%d ", (int)arm_step(q, target, 0.01, 0, c, options, 0, next));
}
int main(void)
{
    const double in[ARM_N] = @inside, out[ARM_N] = @outside, edge[ARM_N] = @edge, c[ARM_R] = @leaf;
    const arm_pose middle = @middle, beyond = @beyond, scaled = @scaled;
    double q[ARM_N];
    arm_options options;
    arm_defaults(&options);
    printf("%d %d %d ", options.stay_inside, (int)arm_inside(in), (int)arm_inside(out));
    step(in, &middle, 0, 0), step(out, &middle, 0, 0), step(edge, &beyond, c, 0);
    step(edge, &beyond, c, &options);
    options.stay_inside = 0;
    step(out, &middle, 0, &options), step(edge, &beyond, c, &options), step(in, &scaled, 0, 0);
    printf("%d", (int)arm_F(&scaled, 0, q));
    return 0;
}
"""


@pytest.mark.slow
def test_a_cells_control_in_c_knows_its_cell_and_the_limits(tmp_path: Path) -> None:
    """Outside the cell, and where a step would pass a joint's limit, it says so; told to go on, it
    goes on."""
    needed("gcc")
    cell = cell_of("pose", 0.3)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    function = rp.InverseFunction(chart_of(cell, q))
    outside = q + np.array([0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0])
    edge, onward, leaf = limit_edge(function)
    rp.export_c(function.inverse, tmp_path, "arm")
    middle, scaled = (
        cell.placement,
        pin.SE3(1.01 * cell.placement.rotation, cell.placement.translation),
    )
    parts = {
        "inside": row(q),
        "outside": row(outside),
        "edge": row(edge),
        "leaf": row(leaf),
        "middle": pose(middle),
    }
    parts |= {"beyond": pose(onward), "scaled": pose(scaled)}
    rp.export_c(function, tmp_path / "F", "arm")
    (tmp_path / "F" / "knows.c").write_text(
        re.sub("@([a-z]+)", lambda found: parts[found[1]], KNOWS)
    )
    run(["gcc", "-std=c99", *STRICT, "arm.c", "knows.c", "-o", "knows", "-lm"], tmp_path / "F")
    assert run(["./knows"], tmp_path / "F") == "1 0 3 0 3 3 3 0 0 2 2"
    run(["gcc", "-std=c99", *STRICT, "arm.c", "check.c", "-o", "check", "-lm"], tmp_path)
    assert run(["./check"], tmp_path).startswith("48 vectors, 0 differences")
    assert (tmp_path / "arm.h").read_text().count("stay_inside = 1") == 1
    for one in (function.inverse, in_numpy(function.inverse)):
        one.step(q, middle, 0.01, outside="raise")
        for start, target, c in ((outside, middle, None), (edge, onward, leaf)):
            one.step(start, target, 0.01, leaf=c)
            with pytest.raises(rp.InputError, match="outside"):
                one.step(start, target, 0.01, leaf=c, outside="raise")


def limit_edge(function: rp.InverseFunction) -> tuple[np.ndarray, pin.SE3, np.ndarray]:
    """A q in the cell, its pose, and a leaf on which a step to that pose takes a joint beyond its
    limit."""
    task, inverse, target = function.task, function.inverse, function.cell.placement
    for way in (0.05, -0.05):
        q = function(target)
        for _ in range(100):  # along the self-motion
            leaf = inverse.leaf(q) + way
            ahead = inverse.step(q, target, 0.01, leaf=leaf)
            if task.limit_margin(ahead).min() < -1e-6:
                return q, target, leaf
            q = ahead
    raise AssertionError("no joint of this cell comes to its limit")
