"""A certificate is tied to what it proves: another design, arm or region drops it, with a note
(issue 37, items 2, 4 and 5)."""

from __future__ import annotations

import copy
import dataclasses
import json
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA
from commands import main
from design_file import checksum
from designs import over, with_potentials

import repctl_pin as rp

FEW = rp.FitOptions(samples=256, held_out=256)
DROPPED = "certificate .* was dropped"


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("panda").task("panda_hand_tcp", "pose")


@pytest.fixture(scope="module")
def certified(task: rp.Task) -> rp.Design:
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(Q_PANDA, 1, 0.3), rp.Box(Q_PANDA, 0.2), options=FEW
    )
    return dataclasses.replace(design, proof=rp.prove(design, margin=0.5, closes=0.005))


@pytest.fixture(scope="module")
def sector(task: rp.Task) -> rp.CellDesign:
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Sector(task, task.placement(Q_PANDA), radius=0.03, height=0.03),
        posture=Q_PANDA,
        degree=2,
        options=FEW,
    )
    return dataclasses.replace(found, proof=rp.prove(found))


def rewritten(file: Path, content: dict) -> Path:
    file.write_text(json.dumps(content | {"checksum": checksum(content)}))
    return file


def test_a_proof_of_another_design_is_dropped(certified: rp.Design) -> None:
    """Issue 37, item 2: a region, coefficients, potentials or an arm that are not the proof's."""
    proof, task = certified.proof, certified.task
    assert proof and f"proved > {0.5}" in certified.summary()
    turned = task.robot.task("panda_link8", "pose")
    inverse = rp.RepeatableInverse(turned, certified.inverse.potentials, region=certified.region)
    for other in (
        over(certified, rp.Box(Q_PANDA, 0.25), proof=None),
        over(certified, rp.Box(Q_PANDA + 1e-6, 0.2), proof=None),
        over(certified, rp.Tube(Q_PANDA[None], 0.2), proof=None),
        with_potentials(
            certified, certified.potentials, certified.coefficients * [1 + 1e-12], proof=None
        ),
        with_potentials(
            certified, rp.Polynomial(Q_PANDA, 1, 0.31), certified.coefficients, proof=None
        ),
        dataclasses.replace(certified, inverse=inverse, proof=None),
    ):
        assert other.subject != certified.subject
        with pytest.warns(UserWarning, match=DROPPED):
            mixed = dataclasses.replace(other, proof=proof)
        assert mixed.proof is None and "found, not proved" in mixed.summary()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept = dataclasses.replace(certified, cost=1.0, shrunk=0.5)
        copies = copy.copy(kept), copy.deepcopy(kept), pickle.loads(pickle.dumps(kept))
        for one in copies:
            assert dataclasses.replace(one, cost=2.0).proof.seal == proof.seal


def test_what_belongs_together_is_not_replaced_in_part(certified: rp.Design) -> None:
    """Issue 37, item 2: replace(inverse=…) was undone by saving, replace(coefficients=…) acted on
    loading only."""
    task = certified.task
    other = rp.RepeatableInverse(
        task, certified.potentials.weighted(1.1 * certified.coefficients), region=certified.region
    )
    elsewhere = rp.RepeatableInverse(task, certified.inverse.potentials)
    for change in (
        {"inverse": other},
        {"inverse": elsewhere},
        {"coefficients": 1.1 * certified.coefficients},
        {"coefficients": certified.coefficients[:-1]},
        {"potentials": rp.Polynomial(Q_PANDA, 1, 0.31)},
        {"region": rp.Box(Q_PANDA, 1.2)},
    ):
        with pytest.raises(rp.InputError, match="cannot be changed in part") as error:
            dataclasses.replace(certified, **change)
        assert "\n" not in str(error.value)
    for change in ({"leaf_margin": 0.99}, {"proved": True, "boxes": 0}, {"subject": "x"}):
        with pytest.raises(rp.InputError, match="a proof cannot be changed in part"):
            dataclasses.replace(certified.proof, **change)


def test_a_certificate_in_a_file_is_checked(certified: rp.Design, tmp_path: Path) -> None:
    """Issue 37, item 2: certificates of other files, changed and old ones, each with a checksum
    that fits."""
    file = rp.save(certified, tmp_path / "d.json")
    content = json.loads(file.read_text())
    small = over(certified, certified.region.shrunk(0.5), proof=None)
    foreign = json.loads(
        rp.save(
            dataclasses.replace(small, proof=rp.prove(small, margin=0.6, closes=False)),
            tmp_path / "small.json",
        ).read_text()
    )["proof"]
    old = {
        key: value
        for key, value in content["proof"].items()
        if key not in ("subject", "seal", "excepted")
    }
    wide = content["region"] | {"half_width": [1.2] * 7}
    away = [[a + 1e-9] for (a,) in content["coefficients"]]
    for change in ({"proof": foreign}, {"proof": old}, {"region": wide}, {"coefficients": away}):
        with pytest.warns(UserWarning, match=DROPPED):
            loaded = rp.load_design(rewritten(file, content | change))
        assert loaded.proof is None and "found, not proved" in loaded.summary()
    for change in ({"leaf_margin": 0.99}, {"proved": False}, {"theorem": 9}):
        with pytest.raises(rp.InputError, match=r"d\.json: a proof cannot be changed"):
            rp.load(rewritten(file, content | {"proof": content["proof"] | change}))
    assert rp.load_design(rewritten(file, content)).proof.seal == certified.proof.seal


def test_a_smaller_region_is_proved_by_name(certified: rp.Design) -> None:
    """Issue 37, item 2: the way that the page names; the proof says what it is of."""
    region = certified.region.shrunk(0.5)
    proof = rp.prove(certified, region=region, margin=0.5, closes=False)
    assert proof and str(region) in proof.what and proof.subject != certified.subject
    assert proof.limit_margin > certified.proof.limit_margin
    with pytest.warns(UserWarning, match=DROPPED):
        assert dataclasses.replace(certified, proof=proof).proof is None


@pytest.mark.slow
def test_a_joint_left_out_of_the_limit_margin_is_named(
    sector: rp.CellDesign, tmp_path: Path
) -> None:
    """Issue 37, item 4: the angle goes as far as the joint that turns the arm, whose margin in the
    set is far below the bound of the others."""
    proof = sector.proof
    assert proof.excepted == ("panda_joint1",)
    assert "(without panda_joint1)" in proof.summary()
    assert "(without panda_joint1)" in repr(proof)
    assert "without panda_joint1" in sector.summary()
    U = np.zeros((201, sector.cell.k))
    U[:, 1] = np.linspace(-1, 1, 201)
    margin = sector.task.limit_margin(sector.function.batch(U))
    assert margin[:, 0].min() < proof.limit_margin <= margin[:, 1:].min()
    file = rp.save(sector, tmp_path / "s.json")
    assert json.loads(file.read_text())["proof"]["excepted"] == ["panda_joint1"]
    assert rp.load_cell(file).proof.seal == proof.seal


@pytest.mark.slow
def test_a_proof_of_another_cell_is_dropped(sector: rp.CellDesign, tmp_path: Path) -> None:
    """Issue 37, item 2, for cells and sectors."""
    content = json.loads(rp.save(sector, tmp_path / "s.json").read_text())
    chart = sector.function.chart
    moved = dataclasses.replace(chart, coefficients=chart.coefficients * (1 + 1e-12))
    wider = dataclasses.replace(chart, cell=chart.cell.scaled(1.01))
    for other in (moved, wider):
        function = rp.InverseFunction(other)
        with pytest.warns(UserWarning, match=DROPPED):
            mixed = dataclasses.replace(sector, function=function)
        assert mixed.proof is None
    widths = [content["widths"][0] * 1.5, *content["widths"][1:]]
    half = content["sector"] | {"free": []}
    for change in ({"widths": widths}, {"sector": half}):
        with pytest.warns(UserWarning, match=DROPPED):
            file = rewritten(tmp_path / "s.json", content | change)
            assert rp.load_cell(file).proof is None


@pytest.mark.slow
def test_a_proof_not_reached_states_no_bound_and_is_not_saved(
    sector: rp.CellDesign, certified: rp.Design, tmp_path: Path
) -> None:
    """Issue 37, item 5: “leaf margin > 0” read as proved; −∞ came back from a file as +∞."""
    for design, failed in (
        (sector, rp.prove(sector, limit_margin=3.0)),
        (certified, rp.prove(certified, margin=0.999, closes=False)),
    ):
        assert not failed
        for text in (failed.summary(), repr(failed)):
            assert "> 0," not in text and "> 0 " not in text and "inf" not in text
        held = dataclasses.replace(design, proof=failed)
        assert "found, not proved" in held.summary()
        assert rp.load(rp.save(held, tmp_path / "f.json")).proof is None
    assert "leaf margin   no bound" in rp.prove(sector, limit_margin=3.0).summary()


@pytest.mark.slow
def test_check_says_by_its_exit_code_that_a_proof_is_not_reached(
    certified: rp.Design, sector: rp.CellDesign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 37, item 5: 0 and a file whose certificate said otherwise, without a word of it."""
    for design in (certified, sector):
        file = rp.save(design, tmp_path / "d.json")
        assert main(["check", str(file), "--prove"]) == 0
        assert "note" not in capsys.readouterr().out
        content = json.loads(file.read_text())
        false = dataclasses.replace(design.proof, seal="", leaf_margin=0.9999999)
        false = false.sealed(design.subject)  # by somebody who knows how
        forged = content["proof"] | {"leaf_margin": 0.9999999, "seal": false.seal}
        rewritten(file, content | {"proof": forged})
        assert main(["check", str(file), "--prove"]) == 3
        said = " ".join(capsys.readouterr().out.split())
        assert said.startswith("NOT proved")
        assert "note: the file's certificate says" in said and "is false" in said
        assert main(["check", str(file), "--prove", "--json"]) == 3
        (note,) = json.loads(capsys.readouterr().out)["notes"]
        assert "do not rely on it" in note


@pytest.mark.slow
def test_the_commands_prove_sectors_and_cells_of_positions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 37, item 5: both were refused with “nothing can be proved of … yet”."""
    arm = ["cell", "planar3r", "--out", str(tmp_path), "--degree", "2"]
    more = ["--start", "0.3,0.8,0.8", "--held-out", "64", "--prove", "--json"]
    for shape in (["--sector", "--radius", "0.05"], ["--half-width", "0.03"]):
        assert main([*arm, "--task", "xy", *shape, *more]) == 0
        assert json.loads(capsys.readouterr().out)["proof"]["proved"]


@pytest.mark.slow
def test_a_design_without_the_proof_says_what_to_do(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    quick_choices: None,
    blank_pictures: None,
) -> None:
    """Issue 37, item 5: the default degree was too high to be proved in a minute."""
    real = rp.prove
    monkeypatch.setattr(rp, "prove", lambda design, **_: real(design, seconds=1e-9))
    arm = ["design", "planar3r", "--region", "0.2", "--degree", "3", "--out", str(tmp_path)]
    few = ["--samples", "256", "--held-out", "64", "--prove"]
    assert main([*arm, *few]) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "NOT proved" in said and "repeat with --degree 2" in said
    assert rp.load_design(tmp_path / "design.json").proof is None
