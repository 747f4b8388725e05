"""What a reader of a study sees without scrolling or pressing: scales, a sentence, how to cite."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import errors, open_page, schemes

import repctl_pin as rp


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    study = rp.study("planar3r", cycles=2, steps=60, degree=1)
    return rp.animation(study).save(tmp_path_factory.mktemp("page") / "animation.html")


@pytest.mark.slow
def test_first_screen(page: Path, driver: Any) -> None:
    """One load for all that follows."""
    schemes(driver, width=1280, height=760)
    open_page(driver, page)
    a_small_drift_is_pale(driver)
    how_to_cite_is_seen_at_once(driver)
    the_menu_says_what_writes_the_control(driver)
    the_sentence_is_seen_where_notes_are_hidden(driver)
    assert errors(driver) == []


def a_small_drift_is_pale(driver: Any) -> None:
    """Colours have a scale of 5 cm or more: 9 mm were in full orange."""
    scales = (
        "return [[1, 0.009], [1, 0.37], [1, 0.5], [50, 0.009]].map(([gain, off]) =>"
        " fullDrift([{ gain, mostOff: () => off }]))"
    )
    assert driver.execute_script(scales) == [0.05, 0.5, 0.5, pytest.approx(0.01)]
    shown = "return [fullDrift(repctl.own.arms), document.getElementById('drift-to').textContent]"
    full, legend = driver.execute_script(shown)
    assert legend.endswith(("cm", "m")) and full in (0.05, 0.1, 0.2, 0.5, 1)


def how_to_cite_is_seen_at_once(driver: Any) -> None:
    driver.find_element("id", "help").click()
    copy = driver.find_element("css selector", "#keys .copy")
    box = copy.rect
    under = driver.execute_script(
        "return document.elementFromPoint(arguments[0], arguments[1])",
        box["x"] + box["width"] / 2,
        box["y"] + box["height"] / 2,
    )
    assert box["y"] + box["height"] < 760 and under == copy
    driver.find_element("css selector", "#keys form button").click()


def the_menu_says_what_writes_the_control(driver: Any) -> None:
    driver.find_element("css selector", "#save summary").click()
    words = driver.find_element("css selector", "#save p")
    assert "control.json" in words.text and "repctl study" in words.text
    driver.find_element("css selector", "#save summary").click()


def the_sentence_is_seen_where_notes_are_hidden(driver: Any) -> None:
    """On a phone, and in another page: with what breaks a limit or collides."""
    shown = "return ['verdict', 'notes'].map((id) => document.getElementById(id).offsetHeight > 0)"
    assert driver.execute_script(shown) == [True, True]
    driver.execute_script("document.body.classList.add('inside')")
    assert driver.execute_script(shown) == [True, False]
    driver.execute_script("document.body.classList.remove('inside')")
    for width, height in ((390, 844), (740, 400)):
        schemes(driver, width=width, height=height)
        assert driver.execute_script(shown) == [True, False], width
