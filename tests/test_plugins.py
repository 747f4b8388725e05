"""Another package's strategies, potentials and paths, found by entry point: a tiny one, installed
for the test."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import named_path
from commands import main

import repctl_pin as rp

MODULE = '''
import numpy as np
import repctl_pin as rp

class Damped:
    """J⁺ by damped least squares."""
    def __init__(self, task):
        self.task = task
    def velocity(self, q, xdot):
        J = self.task.jacobian(q)
        return J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(len(J)), xdot)

def waves(task, q0):
    return rp.Polynomial(q0, 1) + rp.Fourier(task.n, 1, variables=[3])

def ellipse(task, q0, a, b, plane="xy"):
    path = rp.circle(task, q0, a, normal=plane)
    points = [*path.points(41)[:-1], path.point(0.0)]
    return rp.waypoints(points, path.rotation, name=f"ellipse {a} {b}")

def nothing(task):
    return object()

number = 7
'''

ENTRIES = """
[repctl_pin.strategies]
damped = tiny_plugin:Damped
nothing = tiny_plugin:nothing
number = tiny_plugin:number
broken = tiny_plugin_that_is_not_there:Thing

[repctl_pin.potentials]
waves = tiny_plugin:waves

[repctl_pin.paths]
ellipse = tiny_plugin:ellipse
"""


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = tmp_path / "site"
    info = site / "tiny_plugin-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "tiny_plugin.py").write_text(MODULE)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tiny-plugin\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.chdir(tmp_path)


def test_a_strategy_on_the_command_line(capsys) -> None:
    options = ["follow", "panda", "--plane", "yz", "--steps", "60", "--cycles", "2"]
    assert main([*options, "--strategy", "damped"]) == 0
    ours = capsys.readouterr().out
    assert main([*options, "--strategy", "pseudoinverse"]) == 0
    assert ours == capsys.readouterr().out  # the same control, to the digits printed


def test_fields_on_the_command_line(capsys) -> None:
    assert (
        main(
            [
                "follow",
                "panda",
                "--plane",
                "yz",
                "--steps",
                "60",
                "--potentials",
                "waves",
                "--region",
                "0.3",
            ]
        )
        == 0
    )
    assert "joint drift" in capsys.readouterr().out


def test_a_path_wherever_paths_are_named(panda_pose, q_panda, capsys) -> None:
    path = named_path(panda_pose, q_panda, "ellipse:0.1:0.05", "yz")
    assert path.name == "ellipse 0.1 0.05"
    assert np.allclose(path.point(0.0), panda_pose.placement(q_panda).translation)
    command = [
        "follow",
        "panda",
        "--strategy",
        "damped",
        "--path",
        "ellipse:0.05:0.05",
        "--steps",
        "60",
    ]
    assert main(command) == 0
    assert "ellipse" in capsys.readouterr().out
    with pytest.raises(rp.InputError, match="ellipse"):
        named_path(panda_pose, q_panda, "hexagon:1")


@pytest.mark.parametrize(
    "options, words",
    [
        (["--strategy", "dampd"], "did you mean 'damped'"),
        (
            ["--strategy", "broken"],
            "of the package tiny-plugin cannot be imported: ModuleNotFoundError",
        ),
        (["--strategy", "number"], "of the package tiny-plugin must be a function or a class"),
        (["--strategy", "nothing"], "an object without the attributes task and velocity"),
        (["--potentials", "wavs"], "did you mean 'waves'"),
        (["--strategy", "damped", "--path", "elipse:1"], "no path 'elipse:1'"),
    ],
)
def test_what_is_not_there_or_broken(capsys, options: list[str], words: str) -> None:
    assert main(["follow", "panda", *options]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error and error.startswith("repctl: ") and "\n" not in error
