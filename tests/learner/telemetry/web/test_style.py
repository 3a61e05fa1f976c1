"""The style of the page: each of its rules is for something that the page has."""

import re

from learner.telemetry.formats import ended
from learner.telemetry.web.page_sink import PAGE


def test_no_rule_is_for_what_the_page_does_not_have() -> None:
    texts = [(PAGE / name).read_text() for name in ("index.html", "page.js", "charts.js")]
    words = {*re.findall(r"[\w-]+", " ".join(texts)), ended(True), ended(False)}
    style = (PAGE / "page.css").read_text()
    selectors = re.sub(r"/\*.*?\*/|\{[^{}]*\}", "", style, flags=re.DOTALL)
    named = set(re.findall(r"[.#]([a-z][\w-]*)", selectors))
    assert len(named) > 30
    assert named - words == set()
