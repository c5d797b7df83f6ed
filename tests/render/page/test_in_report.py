"""The page inside a report, in Chromium; and the report as it is printed."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from selenium.webdriver.support.wait import WebDriverWait

from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.render.page.assemble import page
from swimmer_mj.render.page.policies import describe
from swimmer_mj.render.report import (
    Part,
    code,
    embedded_page,
    film,
    picture,
    report_page,
    table,
    write_report,
)


@pytest.fixture(scope="module")
def report(browser, tmp_path_factory):
    """A report with the page in it, opened offline."""
    problem = Swimming()
    described = describe(GreedyPolicy(problem, Cascade(problem.n_inputs, 8)), "own", "own", 1.0, None)
    parts = [
        Part(
            "film",
            "Film",
            (film(b"", np.zeros((480, 640, 3), np.uint8), "", ""), picture(Figure((12, 9)), "", "")),
        ),
        Part("steer", "Steer it", (embedded_page(page([described]), "the swimmer"),)),
        Part("table", "Table", (table(("check", "error"), [("x" * 60, "1.0")] * 3), code("y" * 300))),
    ]
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, report_page("Report", "lead", parts, "foot"))
    browser.complaints()
    browser.emulate(scheme="light", motion="reduce")
    browser.resize(1280, 800)
    browser.driver.get(path.as_uri())
    yield browser, path
    browser.driver.switch_to.default_content()
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_the_page_swims_in_the_report(report):
    browser, path = report
    frame = browser.driver.find_element("css selector", "iframe")
    browser.do("arguments[0].scrollIntoView()", frame)
    browser.driver.switch_to.frame(frame)
    WebDriverWait(browser.driver, 60, 0.05).until(lambda _: browser.js("!!window.swimmer"))
    assert browser.js("swimmer.policies()") == ["own"]
    before = browser.js("swimmer.state().time")
    browser.do("swimmer.step(20)")
    assert browser.js("swimmer.state().time") == pytest.approx(before + 0.2)
    browser.driver.switch_to.default_content()
    assert [line for line in browser.complaints() if "video" not in line] == []
    assert [url for url in browser.requests(path) if url != "about:srcdoc"] == [path.as_uri()]


def test_on_paper_it_shows_what_paper_can_show(report):
    browser, _ = report
    shown = "[...document.querySelectorAll(arguments[0])].map((e) => getComputedStyle(e).display !== 'none')"
    assert browser.js(shown, "iframe, video, nav") == [True] * 3
    assert browser.js(shown, ".on-paper") == [False] * 2
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    browser.resize(700, 990)  # A4 less its margins
    assert browser.js(shown, "iframe, video, nav") == [False] * 3
    assert browser.js(shown, ".on-paper") == [True] * 2
    assert browser.js("document.documentElement.scrollWidth") <= 700, "nothing is cut off on the right"
    assert browser.js(
        "[...document.images].filter((i) => i.offsetParent).every((i) => i.getBoundingClientRect().height < 960)"
    )
