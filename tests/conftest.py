"""Robots and tasks that many tests share."""

from __future__ import annotations

import atexit
import gc
import os
import shlex
import shutil
import sys
import tempfile
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")  # the tests run side by side; one core each

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import Q_PANDA
from browser import browser, require_browser
from commands import without_pictures, without_tours
from controls import c_compiler, evaluate_cells_quickly, shared_folder, use_few_nodes
from store import folder

import repctl_pin as rp

TESTS = Path(__file__).parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let long runs be done in parts: ``-m slow --part 2/4``."""
    parser.addoption("--part", default="1/1", metavar="K/N", help="files K, K + N, … of the tests")


def pytest_configure() -> None:
    """Search for garbage more rarely, which took a tenth of the time."""
    gc.set_threshold(100_000, 20, 20)


def all_tests(config: pytest.Config) -> bool:
    """Whether this run was asked for the folder of tests, and not for some of its files."""
    return [Path(given).resolve() for given in config.args] == [TESTS]


def pytest_pycollect_makeitem(collector: pytest.Collector, name: str, obj: Any) -> list | None:
    """Leave functions that are marked slow out of a quick run of all tests: making thousands of
    items that are deselected takes a second in each worker."""
    config = collector.config
    if config.option.markexpr != "not slow" or not all_tests(config):
        return None
    marks = getattr(obj, "pytestmark", ()) if name.startswith("test_") else ()
    return [] if any(mark.name == "slow" for mark in marks) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Compile each file of tests in one worker only; the others read what it wrote.

    On a fresh checkout that takes two thirds of the time of collecting all tests."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None or sys.dont_write_bytecode or not all_tests(session.config):
        return
    number, count = int(worker["workerid"].removeprefix("gw")), worker["workercount"]
    for file in sorted(TESTS.rglob("test_*.py"))[number::count]:
        sys.path.append(str(file.parent))
        with suppress(Exception, pytest.skip.Exception):  # collecting it says why
            import_module(file.stem)
    ready = Path(tempfile.gettempdir(), f"compiled-{worker['testrunuid']}")
    ready.mkdir(exist_ok=True)
    (ready / str(number)).touch()
    atexit.register(shutil.rmtree, ready, ignore_errors=True)
    end = time.monotonic() + 60
    while len(list(ready.iterdir())) < count and time.monotonic() < end:
        time.sleep(0.05)


@pytest.hookimpl(trylast=True)  # after -m and -k
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the longest, mypy and the README, so that no worker is left alone with one.

    Of a part, only every N-th file with tests that are selected is left."""
    longest = ("test_house.py", "repository")

    def place(item: pytest.Item) -> int:
        name = next((name for name in longest if name in item.path.parts), None)
        return len(longest) if name is None else longest.index(name)

    items.sort(key=place)
    part, _, parts = config.getoption("part").partition("/")
    if not (part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise pytest.UsageError(f"--part requires K/N with 1 ≤ K ≤ N; got {part}/{parts}")
    files = sorted({item.path for item in items})
    left = set(files[int(part) - 1 :: int(parts)])
    config.hook.pytest_deselected(items=[item for item in items if item.path not in left])
    items[:] = [item for item in items if item.path in left]


def pytest_collection_finish() -> None:
    """Leave all that is imported and collected out of the search for garbage."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def store_of_results(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Results that are computed once are kept in a folder that the workers share."""
    store = shared_folder(tmp_path_factory) / "results"
    store.mkdir(exist_ok=True)
    folder[:] = [store]


@pytest.fixture(scope="session", autouse=True)
def files_of_robots_are_read_once() -> Iterator[None]:
    """A process reads each URDF once, as long as the file stays the same; most tests read one of a
    few. What is read is frozen."""
    robot = import_module(rp.Robot.__module__)
    read = robot.read_urdf

    @cache
    def known(path: Path, folders: tuple[str, ...], *_: int) -> Any:
        return read(path, folders)

    def read_once(path: str | Path, folders: Sequence[str] = (), data: bytes | None = None) -> Any:
        file = Path(path)
        if data is not None or file.suffix != ".urdf" or not os.path.isfile(file):
            return read(path, folders, data)
        found = file.stat()
        return known(file, tuple(folders), found.st_ino, found.st_size, found.st_mtime_ns)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robot, "read_urdf", read_once)
        yield


@pytest.fixture(scope="session")
def panda() -> rp.Robot:
    return rp.Robot.load("panda")


@pytest.fixture(scope="session")
def panda_pose(panda: rp.Robot) -> rp.Task:
    return panda.task("panda_hand_tcp", "pose")


@pytest.fixture(scope="session")
def q_panda() -> np.ndarray:
    return Q_PANDA.copy()


@pytest.fixture(scope="session")
def panda_design(panda_pose: rp.Task) -> rp.Design:
    """The quadratic design of the theory: J⁺, box ±0.4 rad."""
    return rp.nearest_repeatable(
        rp.Pseudoinverse(panda_pose),
        rp.Polynomial(Q_PANDA, 2, 0.4),
        rp.Box(Q_PANDA, 0.4),
        # also where the first test that asks for it runs with few nodes
        options=rp.FitOptions(samples=16_384, held_out=16_384),
    )


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """One browser for all tests of a process; a small window, since software draws by the pixel."""
    require_browser()
    with browser(560, 480) as driver:
        yield driver


@pytest.fixture
def driver(chromium: Any) -> Iterator[Any]:
    """The browser, with nothing left of what another test asked of it."""
    yield chromium
    chromium.get("about:blank")
    chromium.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    chromium.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    chromium.get_log("browser")


@pytest.fixture
def few_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit and evaluate designs at 1024 nodes, where their number is left to the package."""
    use_few_nodes(monkeypatch)


@pytest.fixture
def two_degrees(monkeypatch: pytest.MonkeyPatch) -> None:
    """Designs of automatic degree end at degree 2: the same in less time."""
    monkeypatch.setattr("repctl_pin.design.nearest._MOST_DEGREE", 2)


@pytest.fixture
def only_starts(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A function that makes configurations, each with its words, the only default starts."""

    def only(*offers: tuple[np.ndarray, str]) -> None:
        starts = "repctl_pin.studies.choose_start.default_starts"
        monkeypatch.setattr(starts, lambda task: iter(offers))

    return only


@pytest.fixture
def quick_choices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Choose starts, circles and tubes by shorter motions and fewer nodes, radii by fewer boxes,
    and the worst poses of cells by shorter searches, for tests of what is done with them; tests of
    design, motion, problem, cells and proof judge the choices themselves."""
    choose_quickly(monkeypatch)


@pytest.fixture(scope="module")
def quick_module() -> Iterator[None]:
    """The same for a whole file of tests and the studies that they share."""
    with pytest.MonkeyPatch.context() as patch:
        choose_quickly(patch)
        yield


QUICK = ("codegen", "paths", "point_to_point", "robot", "saving", "strategies")
"""Rooms whose tests use designs and studies, and judge something else."""


@pytest.fixture(scope="module", autouse=True)
def quick_room(request: pytest.FixtureRequest) -> None:
    """The same for those rooms, and for the tests of the whole package."""
    if request.path.parent.name in ("tests", *QUICK):
        request.getfixturevalue("quick_module")


DESIGNED = ("integrability", "motion", "native", "proof", "regions")
"""Rooms whose tests use designs, and judge motions, bounds and choices made with them."""


@pytest.fixture(scope="module", autouse=True)
def designed_room(request: pytest.FixtureRequest) -> Iterator[None]:
    """Design quickly in those rooms; all other choices are those that users get."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in DESIGNED:
            design_quickly(patch)
        yield


def design_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit and evaluate at fewer nodes, and begin searches for singularities at fewer."""
    use_few_nodes(monkeypatch)
    for module, name, value in (
        ("evaluation", "_CANDIDATES", 8),
        ("fit", "SEARCHED", 256),
        ("singularity_search", "SEARCHED", 256),
        ("singularity_search", "_STARTS", 4),
        ("singularity_search", "_CORNERS", 32),
    ):
        monkeypatch.setattr(import_module("repctl_pin.design." + module), name, value)


def choose_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    design_quickly(monkeypatch)
    evaluate_cells_quickly(monkeypatch)

    def briefly(*given: Any, steps: int, **options: Any) -> rp.Motion:
        return rp.follow(*given, steps=steps // 4, **options)

    def few(samples: int, held_out: int, **options: Any) -> rp.FitOptions:
        return rp.FitOptions(samples=samples // 8, held_out=held_out // 8, **options)

    package = "repctl_pin."
    for module, name, value in (
        ("motion.fitting_circle", "followed", briefly),
        ("motion.solve_ik", "_POINTS", 12),
        ("studies.choose_start", "followed", briefly),
        ("studies.choose_start", "_DRAWN", 128),
        ("studies.around_motion", "FitOptions", few),
        ("extensions.proof.closing_radius", "_MOST", {"start": 1000, "path": 200}),
    ):
        monkeypatch.setattr(import_module(package + module), name, value)


@pytest.fixture
def all_starts(monkeypatch: pytest.MonkeyPatch, quick_module: None) -> None:
    """Select starts from as many configurations as users get, where all else is chosen quickly."""
    package = "repctl_pin."
    monkeypatch.setattr(import_module(package + "studies.choose_start"), "_DRAWN", 512)


@pytest.fixture
def no_tours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the motion along a sample path out of the page of a cell."""
    without_tours(monkeypatch)


@pytest.fixture
def quick_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for the place of a box among fewer middles, and judge fewer, simple designs there."""
    place = import_module(rp.best_cell.__module__)
    for name, value in (
        ("CellFit", partial(place.CellFit, degree=2, samples=128)),
        ("_DRAWN", 1024),
        ("_PARENTS", 6),
        ("_TRIED", 6),
        ("_BATCHES", 1),
        ("_JUDGED", 1),
        ("_CONFIRMED", 1),
        ("_HELD_OUT", 256),
    ):
        monkeypatch.setattr(place, name, value)
    evaluate_cells_quickly(monkeypatch)


@pytest.fixture(scope="session")
def unoptimised(tmp_path_factory: pytest.TempPathFactory) -> str | None:
    """The machine's C compiler as a command of its own that ends with -O0; None without one.

    Its path is part of the key of what it compiles, so the workers share it."""
    command = c_compiler()
    if command is None:
        return None
    script = shared_folder(tmp_path_factory) / "quick-cc"
    draft = script.with_name(f"quick-cc-{os.getpid()}")
    draft.write_text(f'#!/bin/sh\nexec {shlex.join(command)} "$@" -O0\n')
    draft.chmod(0o755)
    draft.replace(script)
    return str(script)


@pytest.fixture
def quick_compiler(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, unoptimised: str | None
) -> None:
    """Compile with -O0, in a fifth of the time, but for tests marked ``as_shipped``."""
    if request.node.get_closest_marker("as_shipped") is None and unoptimised:
        monkeypatch.setenv("CC", shlex.quote(unoptimised))


@pytest.fixture
def blank_pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write one pixel in place of each figure, except where a test is marked ``pictures``."""
    if request.node.get_closest_marker("pictures") is not None:
        return
    without_pictures(monkeypatch)
