"""rp.compiled: the same object, built once, kept where only the user writes; Python where there is
no compiler."""

from __future__ import annotations

import os
import pickle
import stat
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from controls import NEEDS_C, own_cache  # noqa: F401
from strategies.test_control_step import BAD_STEPS
from test_codegen import answer

import repctl_pin as rp


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "repctl_pin" / "compiled"


@NEEDS_C
def test_it_is_the_same_object(panda_design: rp.Design, panda_pose: rp.Task) -> None:
    inverse = panda_design.inverse
    fast = rp.compiled(inverse)
    assert (
        isinstance(fast, rp.RepeatableInverse)
        and fast.task.frame == inverse.task.frame
        and fast.potentials is inverse.potentials
    )
    path = rp.circle(panda_pose, Q_PANDA, 0.1, normal="x")
    motions = [
        rp.follow(one, path, Q_PANDA, cycles=2, steps=100, integrator=rp.LeafLock())
        for one in (inverse, fast)
    ]
    assert (
        np.abs(motions[0].q - motions[1].q).max() < 1e-11
        and motions[1].drift[-1] < 1e-3
    )
    target = panda_pose.placement(Q_PANDA + 0.1)
    assert np.allclose(
        fast.solve(target, Q_PANDA), inverse.solve(target, Q_PANDA), atol=1e-10
    )
    assert np.allclose(fast(Q_PANDA), inverse(Q_PANDA)) and np.array_equal(
        fast.leaf(Q_PANDA), inverse.leaf(Q_PANDA)
    )
    other = pickle.loads(pickle.dumps(fast))
    assert other._loop.own.inverses is not None
    assert np.array_equal(
        other.step(Q_PANDA, target, 0.01), fast.step(Q_PANDA, target, 0.01)
    )


@NEEDS_C
def test_results_are_fresh_and_arguments_untouched(
    panda_design: rp.Design, panda_pose: rp.Task
) -> None:
    fast, target, xdot = (
        rp.compiled(panda_design.inverse),
        panda_pose.placement(Q_PANDA + 0.02),
        np.ones(6),
    )
    q = Q_PANDA.copy()
    q.setflags(write=False)
    first, following = fast.velocity(q, xdot), fast.step(q, target, 0.01, xdot)
    kept = first.copy(), following.copy()
    fast.velocity(q + 0.1, 2 * xdot), fast.step(q + 0.1, target, 0.01)
    assert np.array_equal(first, kept[0]) and np.array_equal(following, kept[1])
    # A bounded step leaves nothing behind that a free one would see.
    step = fast.damped_step(q, target, 0.01, velocity_limit=0.1, damping=0.1)
    assert step.slowed < 1 and np.array_equal(fast.step(q, target, 0.01, xdot), kept[1])
    assert np.allclose(fast.velocity(list(q), [1, 1, 1, 1, 1, 1]), first)
    view = np.stack([q, q], axis=1)[:, 0]
    assert np.array_equal(fast.velocity(view, xdot), first)


@NEEDS_C
@pytest.mark.parametrize("case", BAD_STEPS)
def test_bad_steps_get_the_same_line(
    case: str, panda_design: rp.Design, panda_pose: rp.Task
) -> None:
    inverse, (changed, words) = panda_design.inverse, BAD_STEPS[case]
    good = {
        "q": Q_PANDA + 0.01,
        "target": panda_pose.placement(Q_PANDA),
        "dt": 0.01,
        "leaf": inverse.leaf(Q_PANDA),
    }
    said = []
    fast = rp.compiled(inverse)
    before = fast.step(**good)
    for one in (inverse, fast):
        with pytest.raises(rp.InputError, match=words) as caught:
            one.step(**(good | changed))
        said.append(str(caught.value))
    assert said[0] == said[1] and "\n" not in said[1]
    assert np.array_equal(fast.step(**good), before)


@NEEDS_C
@pytest.mark.parametrize(
    "q, xdot",
    [
        (np.zeros(6), np.ones(6)),
        (np.zeros(7), np.ones(5)),
        (np.zeros(7), 1.0),
        (np.full(7, np.nan), np.ones(6)),
        (np.zeros(7), np.full(6, np.inf)),
    ],
)
def test_bad_velocities_get_the_same_line(q, xdot, panda_design: rp.Design) -> None:
    said = []
    for one in (panda_design.inverse, rp.compiled(panda_design.inverse)):
        with pytest.raises(rp.InputError) as caught:
            one.velocity(q, xdot)
        said.append(str(caught.value))
    assert said[0] == said[1]


@NEEDS_C
def test_singular_is_said_in_the_same_words() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = rp.RepeatableInverse(
        task, rp.Polynomial(np.zeros(3), 1).weighted(np.ones((3, 1)))
    )
    said = []
    for one in (inverse, rp.compiled(inverse)):
        for question in (
            lambda one=one: one.velocity(np.zeros(3), np.ones(2)),
            lambda one=one: one.step(np.zeros(3), pin.SE3.Identity(), 0.01),
        ):
            with pytest.raises(rp.SingularityError) as caught:
                question()
            said.append(str(caught.value))
    assert said[:2] == said[2:]
    with pytest.raises(rp.SingularityError, match="row 1"):
        rp.compiled(inverse).batch(np.array([[0.3, 0.8, 0.8], [0, 0, 0]]))


# ---- the cache
# -------------------------------------------------------------------------------------


def small(size: float = 1.0) -> rp.RepeatableInverse:
    """An inverse that is compiled in no time; each size has code of its own."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    weights = size * np.array([[1.0], [0.5], [0.2]])
    return rp.RepeatableInverse(task, rp.Polynomial(np.zeros(3), 1).weighted(weights))


def loaded() -> set[Path]:
    """The libraries that this process has loaded."""
    maps = Path("/proc/self/maps")
    if not maps.is_file():
        pytest.skip("this system does not say which libraries a process has loaded")
    lines = maps.read_text().splitlines()
    return {Path(line.split()[-1]) for line in lines if line.endswith(".so")}


def in_c(inverse: rp.RepeatableInverse) -> rp.RepeatableInverse:
    """Compile without a warning, so that C serves; it computes what Python does."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fast = rp.compiled(inverse)
    q, xdot = np.array([0.3, 0.8, 0.8]), np.array([0.2, -0.1])
    assert np.allclose(
        fast.velocity(q, xdot), inverse.velocity(q, xdot), rtol=1e-12, atol=0
    )
    return fast


def library_of(inverse: rp.RepeatableInverse) -> Path:
    """Compile an inverse that this process has not compiled; the library that it then loads."""
    before = loaded()
    in_c(inverse)
    (library,) = loaded() - before
    return library


def files(folder: Path) -> set[Path]:
    """The library and its checksum, and nothing that is left over."""
    library, checksum = sorted(folder.iterdir(), key=lambda file: file.suffix != ".so")
    assert library.suffix == ".so" and checksum == library.with_suffix(".sha256")
    return {library, checksum}


@NEEDS_C
def test_it_is_built_once_in_a_private_folder(cache: Path) -> None:
    first = library_of(small())
    built = first.stat().st_mtime_ns
    in_c(small())
    assert first in files(cache) and first.stat().st_mtime_ns == built
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert library_of(small(2.0)) != first


@NEEDS_C
@pytest.mark.parametrize(
    "harm", ["cut short", "replaced", "link", "writable", "no checksum"]
)
def test_what_was_tampered_with_is_built_again(
    harm: str, cache: Path, tmp_path: Path
) -> None:
    library = library_of(small())
    whole, mode = library.read_bytes(), library.stat().st_mode
    if harm in ("cut short", "replaced", "link"):
        library.unlink()  # this process has loaded it
    if harm == "cut short":
        library.write_bytes(whole[:1000])
        library.chmod(mode)
    elif harm == "replaced":
        assert b"_velocity" in whole
        library.write_bytes(whole.replace(b"_velocity", b"_danger__"))
        library.chmod(mode)
    elif harm == "link":
        (tmp_path / "elsewhere").write_bytes(whole)
        (tmp_path / "elsewhere").chmod(mode)
        library.symlink_to(tmp_path / "elsewhere")
    elif harm == "writable":
        library.chmod(0o777)
    else:
        library.with_suffix(".sha256").unlink()
    in_c(small())
    assert library in files(cache)
    status = library.lstat()
    assert (
        stat.S_ISREG(status.st_mode)
        and not status.st_mode & 0o022
        and b"_velocity" in library.read_bytes()
    )
    assert library.read_bytes()[:1000] == whole[:1000]


@NEEDS_C
def test_a_folder_that_others_can_write_is_not_used(cache: Path) -> None:
    cache.mkdir(parents=True)
    cache.chmod(0o777)
    library = library_of(small(3.0))
    assert (
        library.parent != cache and stat.S_IMODE(library.parent.stat().st_mode) == 0o700
    )
    assert not list(cache.iterdir())


@NEEDS_C
def test_four_at_once_do_no_harm(cache: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(in_c, [small() for _ in range(4)]))
    files(cache)


@pytest.mark.parametrize(
    "cc, words",
    [
        ("no-such-compiler", "no C compiler 'no-such-compiler'"),
        ("false", "could not compile"),
        ("'", "CC"),
    ],
)
def test_without_a_compiler_it_says_so_and_python_serves(
    cc: str, words: str, panda_design: rp.Design, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", cc)
    with pytest.warns(UserWarning, match=f"{words}.*; Python serves"):
        slow = rp.compiled(panda_design.inverse)
    assert np.array_equal(
        slow.velocity(Q_PANDA, np.ones(6)),
        panda_design.inverse.velocity(Q_PANDA, np.ones(6)),
    )


def test_no_compiler_at_all(
    panda_design: rp.Design, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    said = one_warning(panda_design.inverse)
    assert said.startswith("no C compiler (cc, gcc, clang) is installed")


@NEEDS_C
def test_one_for_each_thread(panda_design: rp.Design) -> None:
    """Batches release the interpreter's lock; every thread has an inverse of its own."""
    Q = Q_PANDA + np.random.default_rng(0).uniform(-0.3, 0.3, (2000, 7))
    expected = panda_design.inverse.batch(Q)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        inverses = [rp.compiled(panda_design.inverse) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda one: one.batch(Q), inverses):
            assert np.abs(found - expected).max() < 1e-11


@NEEDS_C
def test_a_home_that_cannot_be_written_does_no_harm(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    library = library_of(small(4.0))
    assert library.is_file() and stat.S_IMODE(os.stat(library.parent).st_mode) == 0o700


# ---- compilers that are none
# -----------------------------------------------------------------------

OUT = 'while [ $# -gt 1 ]; do if [ "$1" = -o ]; then out="$2"; fi; shift; done\n'
USELESS = {
    "an empty file": OUT + 'touch "$out"',
    "junk": OUT + 'head -c 5000 /dev/zero > "$out"',
    "a folder": OUT + 'mkdir "$out"',
    "a pipe": OUT + 'mkfifo "$out"',
    "an object file": 'cc -c "$@"',
    "a library cut short": 'cc "$@"\n'
    + OUT
    + 'head -c 3000 "$out" > "$out.cut"; mv "$out.cut" "$out"',
    "another library": OUT
    + 'echo "int other;" > "$out.c"; cc -shared -fPIC "$out.c" -o "$out"',
    "an escape": "printf '\\033]0;title\\007 error \\033[31m' >&2; exit 1",
}


def script(folder: Path, text: str) -> str:
    """A compiler of one's own making."""
    file = folder / "my-cc"
    file.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    file.chmod(0o755)
    return str(file)


def one_warning(inverse: rp.RepeatableInverse) -> str:
    """Compile in vain: what is said, once; Python serves."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        slow = rp.compiled(inverse)
    assert np.array_equal(
        slow.velocity(Q_PANDA, np.ones(6)), inverse.velocity(Q_PANDA, np.ones(6))
    )
    (said,) = (str(warning.message) for warning in caught)
    assert said.endswith("; Python serves") and said.isprintable() and len(said) < 400
    return said


@NEEDS_C
@pytest.mark.parametrize("made", USELESS)
def test_a_compiler_that_makes_nothing_of_use_is_one_warning(
    made: str,
    panda_design: rp.Design,
    cache: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", script(tmp_path, USELESS[made]))
    one_warning(panda_design.inverse)
    assert not list(cache.glob("*.so"))


@pytest.mark.parametrize("text", ["trap '' TERM; sleep 600 & sleep 600", "yes >&2"])
def test_a_compiler_that_hangs_is_ended_with_its_children(
    text: str,
    panda_design: rp.Design,
    cache: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", script(tmp_path, f"echo $$ > {tmp_path}/group; {text}"))
    monkeypatch.setattr("repctl_pin.c_library._COMPILES", 0.2)
    assert "took longer than 0.2 s; Python" in one_warning(panda_design.inverse)
    with pytest.raises(ProcessLookupError):
        for _ in range(100):  # what was killed is gone a moment later
            os.killpg(int((tmp_path / "group").read_text()), 0)
            time.sleep(0.05)
    (tmp_path / "group").unlink()
    assert "is not run again" in one_warning(panda_design.inverse)
    assert not (tmp_path / "group").exists()  # the compiler was not started again


@NEEDS_C
@pytest.mark.parametrize("place", ["library", "checksum", "pipe"])
def test_a_folder_or_a_pipe_in_a_files_place_does_no_harm(
    place: str, cache: Path
) -> None:
    library = library_of(small())
    file = library if place == "library" else library.with_suffix(".sha256")
    file.unlink()
    os.mkfifo(file, 0o600) if place == "pipe" else file.mkdir()
    in_c(small())


@NEEDS_C
def test_without_a_home_a_temporary_folder_serves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No HOME, and a user whom the system does not know."""
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    with pytest.raises(RuntimeError):
        Path.home()
    assert library_of(small(5.0)).is_file()


# ---- large numbers, and rotations that are none
# ----------------------------------------------------


@NEEDS_C
@pytest.mark.parametrize("size", [1e100, 1e150])
@pytest.mark.parametrize(
    "where", ["q", "leaf", "a coefficient", "xdot", "a twist", "dt", "a target"]
)
def test_large_numbers_have_one_rule_in_python_and_c(
    size: float, where: str, panda_pose: rp.Task
) -> None:
    A = np.append(
        rp.redundancy.nullspace(panda_pose.jacobian(Q_PANDA))[:, 0], np.full(28, 0.01)
    )[:, None]
    A[7] = size if where == "a coefficient" else A[7]
    inverse = rp.RepeatableInverse(
        panda_pose, rp.Polynomial(Q_PANDA, 2, 0.5).weighted(A)
    )
    fast, q, xdot, twist, far = (
        rp.compiled(inverse),
        Q_PANDA + 0.01,
        np.ones(6),
        np.ones(6),
        panda_pose.placement(Q_PANDA),
    )
    leaf, dt = inverse.leaf(Q_PANDA), size if where == "dt" else 0.01
    for name, array in (("q", q), ("xdot", xdot), ("a twist", twist), ("leaf", leaf)):
        array[0] = size if where == name else array[0]
    far = pin.SE3(far.rotation, np.full(3, size)) if where == "a target" else far

    def damped(one: rp.RepeatableInverse) -> np.ndarray:
        return one.step(q, far, dt, twist, leaf=leaf, velocity_limit=1.0, damping=0.1)

    for ask in (
        lambda one: one.velocity(q, xdot),
        lambda one: one.step(q, far, dt, twist, leaf=leaf),
        damped,
    ):
        answers = [answer(lambda one=one, ask=ask: ask(one)) for one in (inverse, fast)]
        if any(isinstance(a, str) for a in answers):
            assert answers[0] == answers[1]
        else:
            assert np.isfinite(answers).all()
            hard = where in (
                "q",
                "a coefficient",
            )  # singular values of rows of 1 and 1e100 are those of rounding
            assert np.allclose(*answers, rtol=1e-6) or (hard and ask is damped)


TURNS = {
    "reflected": np.diag([1.0, 1.0, -1.0]),
    "ones": np.ones((3, 3)),
    "twice": 2.0,
    "1e-5 too large": 1 + 1e-5,
}


@NEEDS_C
@pytest.mark.parametrize("name", TURNS)
def test_what_is_no_rotation_is_refused_in_c_too(
    name: str, panda_design: rp.Design
) -> None:
    inverse, task = panda_design.inverse, panda_design.task
    here = task.placement(Q_PANDA)
    R = TURNS[name] * here.rotation if np.isscalar(TURNS[name]) else TURNS[name]
    said = []
    for one in (inverse, rp.compiled(inverse)):
        one.step(Q_PANDA, pin.SE3((1 + 1e-8) * here.rotation, here.translation), 0.01)
        with pytest.raises(rp.InputError) as caught:
            one.step(Q_PANDA, pin.SE3(R, here.translation), 0.01)
        said.append(str(caught.value))
    assert said[0] == said[1]
