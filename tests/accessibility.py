"""Find with axe-core what of a page some people could not read or use, in all of its frames."""

from __future__ import annotations

from typing import Any

import pytest

_RULES = "{rules: {dlitem: {enabled: false}}, iframes: false}"
"""Since HTML 5.2 a <div> may group <dt> and <dd>. Each frame is looked at by itself."""


def violations(driver: Any) -> list[tuple[str, list[str]]]:
    """Names of the rules that the page or a frame in it breaks, with the elements."""
    axe = pytest.importorskip("axe_selenium_python").Axe(driver)
    axe.inject()
    found = [
        (rule["id"], [node["html"][:200] for node in rule["nodes"]])
        for rule in axe.run(options=_RULES)["violations"]
    ]
    for frame in driver.find_elements("tag name", "iframe"):
        driver.switch_to.frame(frame)
        found += violations(driver)
        driver.switch_to.parent_frame()
    return found
