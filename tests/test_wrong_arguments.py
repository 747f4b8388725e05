"""Everything at the door refuses what is wrong by name: a seeded sample of wrong arguments,
generated from a table."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from wrong_arguments import Call, all_wrong, outcome, right_calls

import repctl_pin as rp

SLOW = ("animation", "best_cell", "best_leaf", "nearest_", "study", "stable_", "export_c")
"""What is left to the slow test: a call that is taken, though one of its arguments is odd, takes
its time."""


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> list[Call]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return right_calls(tmp_path_factory.mktemp("calls"))


def tried(
    calls: list[Call], count: int, seed: int, *, quick: bool
) -> tuple[Counter[str], list[str]]:
    """Try so many wrong arguments at random: how many were refused, taken or mishandled, and which
    were that."""
    tries = [one for one in all_wrong(calls) if not (quick and one[0].name.startswith(SLOW))]
    counts: Counter[str] = Counter()
    mishandled = []
    for i in np.random.default_rng(seed).permutation(len(tries))[:count]:
        call, name, what, value = tries[i]
        came = outcome(call, {name: value})
        counts[came if came in ("refused", "taken") else "mishandled"] += 1
        if came not in ("refused", "taken"):
            mishandled.append(f"{call.name}({name} = {what}): {came}")
    return counts, mishandled


@pytest.mark.slow
def test_a_sample_is_refused_by_name(calls: list[Call], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    counts, mishandled = tried(calls, 100, 0, quick=True)
    assert mishandled == []
    assert counts["refused"] > 0.7 * counts.total()


@pytest.mark.slow
def test_ten_thousand_are_refused_by_name(calls: list[Call], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    _, mishandled = tried(calls, 10_000, 1, quick=False)
    assert len(mishandled) <= 10, "\n".join(mishandled)  # 0.1 %
    assert not [line for line in mishandled if line.endswith("hung")]


@pytest.mark.slow
def test_the_right_calls_are_right(
    calls: list[Call], tmp_path: Path, monkeypatch, quick_choices: None, quick_places: None
) -> None:
    """Else what is refused would say nothing."""
    monkeypatch.chdir(tmp_path)
    refused = {c.name: came for c in calls if (came := outcome(c, {})) != "taken"}
    assert refused == {}


def test_huge_counts_are_refused(calls: list[Call]) -> None:
    by_name = {call.name: call for call in calls}
    following = ("cycles", "steps")
    for count in (10**9, 10**19):
        assert outcome(by_name["FitOptions"], {"restarts": count}) == "refused"
        for name in ("held_out", "samples"):
            options = rp.FitOptions(**{name: count})
            assert outcome(by_name["nearest_repeatable"], {"options": options}) == "refused"
        assert [outcome(by_name["follow"], {name: count}) for name in following] == ["refused"] * 2
        assert outcome(by_name["LeafLock"], {"corrections": count}) == "refused"
        assert outcome(by_name["Box.random"], {"count": count}) == "refused"
        with pytest.raises(rp.InputError, match="fit into memory|cycles can be"):
            rp.study(
                "planar3r",
                cycles=count,
                progress=lambda text: pytest.fail(text) if "design" in text else None,
            )
    assert outcome(by_name["Motion.cycle"], {"k": 99}) == "refused"
    assert outcome(by_name["solve_ik"], {"tolerance": np.inf}) == "refused"


@pytest.mark.parametrize("method", ["at", "where"])
@pytest.mark.parametrize("u", [np.nan, [np.nan, 0.0], [0.0], "middle", None])
def test_a_place_in_a_cell_is_k_finite_numbers(calls: list[Call], method: str, u: object) -> None:
    cell = next(call for call in calls if call.name == f"Cell.{method}").function.__self__
    with pytest.raises(
        rp.InputError, match="u must be 2 finite numbers, one per coordinate of the cell"
    ):
        getattr(cell, method)(u)
