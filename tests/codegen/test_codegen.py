"""Generated C: the same numbers and the same refusals as Python, and nothing of a file's words but
comments."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA, planar_urdf, spatial_urdf
from cell_functions import cell_of
from commands import main, refused, told
from controls import CONTROLS, NEEDS_C, in_numpy, some, target_at
from test_bases import Ball

import repctl_pin as rp

AGREE = 1e-11


Answer = np.ndarray | str


def answer(question: Callable[[], Any]) -> Answer:
    """A result, or the kind of error."""
    try:
        return np.asarray(question(), float)
    except rp.InputError:
        return "bad number"
    except rp.SingularityError:
        return "singular"


def questions(
    inverse: rp.RepeatableInverse, q0: np.ndarray, q: np.ndarray, rng: np.random.Generator
) -> Iterator:
    """Velocities and steps of every kind at one q: functions of an inverse."""
    task = inverse.task
    xdot, twist = rng.normal(size=task.m), rng.normal(size=task.twist_size)
    near = q + 0.05 * rng.normal(size=task.n)
    turn = pin.SE3(pin.exp3(1.2 * rng.normal(size=3)), 0.2 * rng.normal(size=3))
    target, far = target_at(task, near), target_at(task, near, turn)
    leaf, limit = inverse.leaf(q0), rng.uniform(0.2, 3, task.n)
    yield lambda one: one.velocity(q, xdot)
    yield lambda one: one.step(q, target, 0.01)
    yield lambda one: one.step(q, far, 0.01, leaf=leaf)
    yield lambda one: one.step(q, target, 0.01, twist, leaf=leaf, gain=40.0)

    def bounded(one: rp.RepeatableInverse) -> np.ndarray:
        step = one.damped_step(
            q, far, 0.01, twist, leaf=leaf, gain=60.0, velocity_limit=limit, damping=0.15
        )
        return np.append(step.q, [step.damping, step.slowed])

    yield bounded
    yield lambda one: one.step(q, far, 0.01, twist, leaf=leaf, velocity_limit=0.5)


def disagreement(
    inverse: rp.RepeatableInverse, q0: np.ndarray, count: int, *, spread: float = 0.5
) -> tuple[float, int]:
    """The greatest difference between Python and C, and how many are refused.

    Relative where a result is above 1, and to what rounding does where J_V's condition is above
    10⁴."""
    plain, rng, worst, none = in_numpy(inverse), np.random.default_rng(1), 0.0, 0
    for k in range(count):
        q = q0 + spread * rng.uniform(-1, 1, len(q0)) * (5.0 if k % 8 == 7 else 1.0)
        if k % 16 == 15:
            q = np.zeros_like(q)  # stretched, for many an arm
        J_V = np.vstack([inverse.task.jacobian(q), inverse.potentials.gradient(q).T])
        hard = max(1.0, 1e-4 * float(np.linalg.cond(J_V)))
        for ask in questions(inverse, q0, q, rng):
            python, c = (answer(lambda ask=ask: ask(plain)), answer(lambda ask=ask: ask(inverse)))
            assert isinstance(python, str) == isinstance(c, str), (k, q, python, c)
            if isinstance(python, str):
                assert python == c
                none += 1
            else:
                worst = max(
                    worst, float(np.abs(python - c).max() / max(1.0, np.abs(python).max())) / hard
                )
    return worst, none


QUICK = (
    "panda, pose, degree 2",
    "panda, pose, joined",
    "talos from its torso",
    "ppr, degree 5 of some joints",
    "random axes and slides",
    "elbow and hand of panda",
)


def test_vectors_outside_the_region_are_well_conditioned(tmp_path: Path) -> None:
    """Of an arm written by hand, a torque near a singularity was 5e-9 off in C: check.c failed."""
    inverse, q0 = CONTROLS["panda, pose, degree 4"](tmp_path)
    rp.export_c(inverse, tmp_path, "arm")
    text = (tmp_path / "test_vectors.h").read_text().partition("arm_vectors[")[2]
    rows = re.findall(r"(?m)^    \{\{([-\d., e]+)\},$", text)  # without those that are not finite
    Q = np.array([[float(number) for number in row.split(",")] for row in rows])
    assert len(Q) > 40 and np.abs(Q - q0).max() > 1  # some are far from the start
    J, V = inverse.task.jacobians(Q), np.swapaxes(inverse.potentials.gradients(Q), 1, 2)
    assert np.linalg.cond(np.concatenate([J, V], axis=1)).max() < 1e3


@NEEDS_C
@pytest.mark.parametrize("name", [pytest.param(QUICK[0], marks=pytest.mark.as_shipped), *QUICK[1:]])
def test_c_computes_what_python_computes(name: str, tmp_path: Path) -> None:
    inverse, q0 = CONTROLS[name](tmp_path)
    worst, _ = disagreement(inverse, q0, 32)
    assert worst < AGREE


@NEEDS_C
def test_a_leaf_that_overflows_is_refused() -> None:
    """Item 26.18: q is finite, and a cubic h of it is not; OK with an infinite c was returned."""
    q0 = np.array([0.3, 0.8, 0.8])
    task, cubic = rp.Robot.load("planar3r").task("tool", "xy"), rp.Polynomial(q0, 3)
    inverse = rp.RepeatableInverse(task, cubic.weighted(np.ones((cubic.size, 1))))
    assert np.isclose(inverse.leaf(q0 + 1e100) / 1e300, in_numpy(inverse).leaf(q0 + 1e100) / 1e300)
    for huge in (1e110, 1e300):
        with pytest.raises(rp.InputError, match=r"q is so large that h\(q\) is not finite"):
            inverse.leaf(q0 + huge)


@NEEDS_C
@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLS)
def test_c_computes_what_python_computes_at_10000(name: str, tmp_path: Path) -> None:
    inverse, q0 = CONTROLS[name](tmp_path)
    worst, none = disagreement(inverse, q0, 10_000)
    print(f"{name}: {worst:.1e}, {none} refused")
    assert worst < 10 * AGREE  # of so many, some are nearly singular


@NEEDS_C
def test_singular_configurations_are_refused_alike() -> None:
    """A stretched planar arm, and the panda's own singularities."""
    inverse, _ = CONTROLS["planar7r, xy, degree 3"](Path())
    plain = in_numpy(inverse)
    target, count = pin.SE3(np.eye(3), np.array([1.0, 0.5, 0.0])), 0
    for q in (np.zeros(7), np.eye(7)[0], np.eye(7)[0] * 1e-9, np.r_[0.3, np.zeros(6)]):
        for ask in (
            lambda one, q=q: one.velocity(q, np.ones(2)),
            lambda one, q=q: one.step(q, target, 0.01),
        ):
            assert [answer(lambda ask=ask, one=one: ask(one)) for one in (plain, inverse)] == [
                "singular"
            ] * 2
            count += 1
        ours, theirs = (one.damped_step(q, target, 0.01, damping=0.1) for one in (plain, inverse))
        assert np.abs(ours.q - theirs.q).max() < AGREE
        assert ours.damping == pytest.approx(theirs.damping) != 0
    assert count == 8


def nearly_singular(task: rp.Task, q0: np.ndarray, size: float) -> rp.RepeatableInverse:
    """V constant, its first column in J's row space at q0, and as long as asked."""
    J, rng = task.jacobian(q0), np.random.default_rng(6)
    V = rp.redundancy.nullspace(J)
    V[:, 0] = J.T @ rng.normal(size=task.m)
    return rp.RepeatableInverse(task, rp.Polynomial(q0, 1).weighted(size * V))


def least_sine(A: np.ndarray) -> float:
    """The least sine of the angle between a row and the span of the others, by projection."""
    A = A / np.linalg.norm(A, axis=1)[:, None]
    bases = [np.linalg.qr(np.delete(A, i, axis=0).T)[0] for i in range(len(A))]
    return min(float(np.linalg.norm(a - Q @ (Q.T @ a))) for a, Q in zip(A, bases, strict=True))


@NEEDS_C
@pytest.mark.parametrize("size", some([1.0, 1e-8, 1e8], 1.0, 1e8))
@pytest.mark.parametrize("arm, kind", [("panda", "pose"), ("tiago", "position"), ("ppr", "xy")])
def test_near_singular_configurations_are_refused_alike(arm: str, kind: str, size: float) -> None:
    """Sines from 1e-8 to 1e-3, on both sides of the least, 1e-6: neither units nor the potential's
    size count."""
    task, rng = rp.Robot.load(arm).task(None, kind), np.random.default_rng(4)
    q0 = task.reference + rng.uniform(0.2, 0.6, task.n)
    inverse = nearly_singular(task, q0, size)
    plain, xdot, V_T = (
        in_numpy(inverse),
        rng.normal(size=task.m),
        inverse.potentials.gradient(q0).T,
    )
    target, leaf, said = task.placement(q0), inverse.leaf(q0), []
    questions = [
        lambda one, q: one.velocity(q, xdot),
        lambda one, q: one.step(q, target, 0.01, leaf=leaf),
        lambda one, q: one.step(q, target, 0.01, velocity_limit=0.5),
        lambda one, q: one.batch(q[None]),
        lambda one, q: one.velocities(q[None], xdot[None]),
    ]
    for exponent in np.linspace(-8, -3, 60):
        q = q0 + 10.0**exponent * rng.normal(size=task.n)
        sine = least_sine(np.vstack([task.jacobian(q), V_T]))
        if abs(sine / 1e-6 - 1) < 1e-3:
            continue
        expected = "singular" if sine < 1e-6 else "answered"
        for ask in questions:
            for one in (plain, inverse):
                found = answer(lambda ask=ask, one=one, q=q: ask(one, q))
                assert (found if isinstance(found, str) else "answered") == expected, (
                    sine,
                    exponent,
                )
        said.append(expected)
    assert min(said.count("singular"), said.count("answered")) > 10


@NEEDS_C
@pytest.mark.parametrize("what", ["velocities", "batch"])
def test_batches_are_rows(what: str, panda_design: rp.Design) -> None:
    inverse, rng = panda_design.inverse, np.random.default_rng(2)
    plain = in_numpy(inverse)
    Q, Xdot = Q_PANDA + rng.uniform(-0.4, 0.4, (50, 7)), rng.normal(size=(50, 6))
    if what == "velocities":
        pairs = plain.velocities(Q, Xdot), inverse.velocities(Q[:, ::-1][:, ::-1], Xdot)
        with pytest.raises(rp.InputError, match="Ẋ"):
            inverse.velocities(Q, Xdot[:3])
    else:
        pairs = plain.batch(Q), inverse.batch(Q)
        with pytest.raises(rp.InputError, match="batch"):
            inverse.batch(Q[0])
    assert np.abs(pairs[0] - pairs[1]).max() < AGREE


# ---- text
# ------------------------------------------------------------------------------------------


HOSTILE = [
    'a"b',
    "two\nlines",
    "*/ int x; /*",
    "??/",
    "\\",
    "%s%n",
    "../../etc",
    "ä€𝄞",
    "x" * 5000,
    "//",
    "\r",
    "@about",
]


@pytest.mark.parametrize("words", some(HOSTILE, "*/ int x; /*", "??/"))
def test_no_words_end_a_comment(words: str, tmp_path: Path) -> None:
    """A robot's name is in the header's comment: in ASCII, in one line, of a sensible length."""
    codes = []
    for name, folder in (("ppr", "plain"), (words, "hostile")):
        inverse, _ = CONTROLS["ppr, degree 5 of some joints"](tmp_path)
        inverse.task.robot.name = name
        header, *_ = rp.export_c(inverse, tmp_path / folder, "arm")
        _, _, code = header.read_bytes().decode("ascii").partition("\n")  # checksum
        codes.append(code)
    before, _, after = codes[0].partition("robot   ppr ")
    assert codes[1].startswith(before) and codes[1].endswith(after)
    text = codes[1].removeprefix(before + "robot   ").removesuffix(" " + after)
    assert text.isascii() and text.isprintable() and 0 < len(text) <= 6 * 80
    assert not set(text) & set("*/?\"'%@#") and not text.endswith("\\")
    assert re.sub(r"\\u[0-9a-f]{4}", "", text).count("\\") == 0


def test_a_hostile_urdf_gets_into_comments_only(tmp_path: Path) -> None:
    """The same arm with harmless names gives the same code, comments aside; and no file outside the
    folder."""
    texts = {}
    hostile = {
        "spatial": '*/ #error "no" /*',
        "q1": "q1??/",
        "tool": "t*/x",
        "link1": "../l&quot;1",
    }
    for kind in ("plain", "hostile"):
        urdf = spatial_urdf(4, 3)
        if kind == "hostile":
            for name, words in hostile.items():
                urdf = urdf.replace(f'"{name}"', f"'{words}'")
        path = tmp_path / f"{kind}.urdf"
        path.write_text(urdf, encoding="utf-8")
        robot = rp.Robot.load(path)
        task = robot.task("tool" if kind == "plain" else hostile["tool"], "position")
        potentials = rp.Polynomial(task.reference, 1)
        inverse = rp.RepeatableInverse(task, potentials.weighted(np.ones((4, 1))))
        files = rp.export_c(inverse, tmp_path / kind)
        assert sorted(file.parent for file in files) == [tmp_path / kind] * 8
        code = "".join(file.read_text(encoding="ascii") for file in files)
        assert "??" not in code and max(map(len, re.findall(r"/\*.*?\*/", code, re.DOTALL))) < 4000
        code = re.sub(r"/\*.*?\*/", "", code, flags=re.DOTALL)
        names = re.search(r"joint_names\[\w+\] = \{(.*)\};", code)
        assert names and re.fullmatch(r'("(\w|\\\d{3})*"(, )?)*', names[1], re.ASCII)
        frame = re.search(r'frame = ("(?:\w|\\\d{3})*");', code, re.ASCII)
        assert frame
        texts[kind] = code.replace(names[1], "").replace(frame[1], "")
    assert texts["plain"] == texts["hostile"]
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "hostile",
        "hostile.urdf",
        "plain",
        "plain.urdf",
    ]


def test_two_exports_give_the_same_bytes(panda_design: rp.Design, tmp_path: Path) -> None:
    first, second = (
        rp.export_c(
            panda_design.inverse, tmp_path / folder, "panda_control", region=panda_design.region
        )
        for folder in "ab"
    )
    assert [f.name for f in first] == [f.name for f in second] and len(first) == 8
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    header = first[0].read_text()
    for words in (
        rp.__version__,
        "panda (panda.urdf)",
        "panda_hand_tcp",
        "v, omega",
        "panda_joint7, rad",
        "box +-0.4",
    ):
        assert words in header


@pytest.mark.parametrize(
    "name", ["", "3d", "a-b", "int", "Math", "check", "a__b", "_a", "ä", "x" * 41, "a/b", "a\n", 3]
)
def test_names_that_c_cannot_have_are_refused(
    name: Any, panda_design: rp.Design, tmp_path: Path
) -> None:
    with pytest.raises(rp.InputError) as caught:
        rp.export_c(panda_design.inverse, tmp_path, name)
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_what_cannot_be_written_down_is_refused(
    panda_pose: rp.Task, panda_design: rp.Design, tmp_path: Path
) -> None:
    own = rp.CustomPotentials([lambda q: float(q[0])]).weighted(np.ones((1, 1)))
    for inverse, words in (
        (rp.RepeatableInverse(panda_pose, own), "CustomMap cannot be written"),
        (rp.ExtendedJacobian(panda_pose, Q_PANDA), "ExtendedMap cannot be written"),
        (rp.Pseudoinverse(panda_pose), "inverse must be a repeatable inverse"),
    ):
        for refuse in (lambda inverse: rp.export_c(inverse, tmp_path),):
            with pytest.raises(rp.InputError, match=words):
                refuse(inverse)
    with pytest.raises(rp.InputError, match="a region of type Ball cannot be written"):
        rp.export_c(panda_design.inverse, tmp_path, region=Ball(np.zeros(7), 1.0))
    with pytest.raises(rp.InputError, match="the region has 3 joints, but the task has 7"):
        rp.export_c(panda_design.inverse, tmp_path, region=rp.Box(np.zeros(3), 1))
    for own_region in (Ball(np.zeros(7), 1.0), cell_of("pose", 0.3)):
        inverse = rp.RepeatableInverse(
            panda_pose, panda_design.inverse.potentials, region=own_region
        )
        with pytest.raises(rp.InputError, match="or an inverse without a region"):
            rp.export_c(inverse, tmp_path)


def test_the_region_of_the_inverse_is_written(panda_design: rp.Design, tmp_path: Path) -> None:
    """Issue 37, item 9: the inverse's own Ω was dropped unless region= named it again."""
    control = panda_design.inverse
    free = rp.RepeatableInverse(control.task, control.potentials)
    given = {"own": None, "named": panda_design.region}
    for name, region in given.items():
        rp.export_c(control, tmp_path / name, region=region)
    rp.export_c(free, tmp_path / "free")
    smaller = rp.Box(panda_design.region.center, 0.1)
    rp.export_c(control, tmp_path / "smaller", region=smaller)
    own, named, none, small = (
        (tmp_path / name / "arm_control.c").read_text() for name in (*given, "free", "smaller")
    )
    assert own == named and len({own, none, small}) == 3
    assert "tables_region[1]" in own
    assert "tables_region[1]" not in none


# ---- the command
# -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_writes_a_saved_design(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(planar_urdf([1, 0.8, 0.6]), encoding="utf-8")
    small = ["--degree", "1", "--samples", "256", "--held-out", "256", "--region", "0.2", "--quiet"]
    assert main(["design", "arm.urdf", "--start", "0.3,0.8,0.8", *small, "--out", "."]) == 0
    capsys.readouterr()
    assert "is not a saved design" in refused(capsys, "export", "arm.urdf")
    assert "give the path of its file: --robot arm.urdf" in refused(capsys, "export", "design.json")
    given = ["export", "design.json", "--robot", "arm.urdf"]
    assert "is reserved in C" in refused(capsys, *given, "--name", "double")
    said = told(capsys, *given, "--out", "c", "--name", "planar")
    assert said["n"] == 3 and {Path(f).name for f in said["files"]} >= {
        "planar.h",
        "planar.c",
        "check.c",
    }
    assert "already contains the export 'planar'" in refused(
        capsys, *given, "--out", "c", "--name", "other"
    )
    assert told(capsys, *given, "--out", "c", "--name", "planar")["files"] == said["files"]
    assert main([*given, "--out", "d"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "wrote d/arm_control.h"
    assert "box +-0.2" in Path("d/arm_control.c").read_text()


OURS = (
    *("CMakeLists.txt", "loop.c", "check.c", "test_vectors.h"),
    *("arm.c", "arm.h", "arm.hpp", "arm_kdl.hpp"),
)


@pytest.mark.parametrize(
    ("file", "theirs"),
    [
        *(
            pytest.param(file, "a file of the user's", marks=pytest.mark.slow)
            for file in OURS[1:-1]
        ),
        *(pytest.param(file, "an edited file", marks=pytest.mark.slow) for file in OURS[3::3]),
        (OURS[0], "an edited file"),
        (OURS[-1], "a file of the user's"),
        (OURS[0], "an empty file"),
    ],
)
def test_a_file_that_was_not_written_here_is_not_overwritten(
    file: str, theirs: str, tmp_path: Path
) -> None:
    inverse, _ = CONTROLS["ppr, degree 5 of some joints"](tmp_path)
    folder = tmp_path / "c"
    if theirs == "an edited file":
        rp.export_c(inverse, folder, "arm")
        rp.export_c(inverse, folder, "arm")  # its own files are
        text = (folder / file).read_text(encoding="utf-8").replace("1", "2", 1) + "\n"
    else:
        folder.mkdir()
        text = "project(mine)\n" if theirs == "a file of the user's" else ""
    (folder / file).write_text(text, encoding="utf-8")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(
        rp.InputError,
        match=f"{re.escape(file)} is not overwritten: it was not written by repctl_pin",
    ):
        rp.export_c(inverse, folder, "arm")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
