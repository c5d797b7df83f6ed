import json
import os
import shutil
import tempfile

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.wait import WebDriverWait

from swimmer_mj.cli import main

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--window-size=1280,800",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # offline
)  # fmt: skip
MISSING = (
    "the page is tested in Chromium, of which {} is missing: sudo apt-get install chromium chromium-driver"
)


def program(*names):
    """The first of the programs that there is."""
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        pytest.fail(MISSING.format(" or ".join(names)))
    return found


class Browser:
    """Chromium with one page in it; `do` runs JavaScript, `js` gives the value of an expression."""

    def __init__(self, driver):
        self.driver = driver
        self.do = driver.execute_script

    def js(self, expression, *arguments):
        return self.do(f"return {expression}", *arguments)

    def open(self, path, *, motion=True):
        """Open the file and wait until the swimmer is there, paused unless ``motion`` is left to the page."""
        self.emulate(scheme="light", motion="no-preference" if motion else "reduce")
        self.driver.get(path.as_uri())
        WebDriverWait(self.driver, 60, 0.02).until(lambda _: self.js("!!window.swimmer"))

    def emulate(self, scheme, motion="no-preference"):
        features = {"prefers-color-scheme": scheme, "prefers-reduced-motion": motion}
        self.driver.execute_cdp_cmd(
            "Emulation.setEmulatedMedia",
            {"features": [{"name": name, "value": value} for name, value in features.items()]},
        )

    def resize(self, width, height, mobile=False):
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile},
        )

    def drawn(self):
        """Wait until what has changed has been drawn."""
        self.driver.execute_async_script(
            "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
        )

    def complaints(self):
        """What the console has had to say since the last time."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self, path):
        """Addresses that the page at ``path`` has asked for since the last time, other than parts of itself."""
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        sent = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
        asked = [one["request"]["url"] for one in sent if one["documentURL"] == path.as_uri()]
        return [url for url in asked if not url.startswith(("data:", "blob:"))]


@pytest.fixture(scope="session")
def browser():
    options = Options()
    options.binary_location = program("chromium", "google-chrome")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = Service(program("chromedriver"), log_output=os.devnull)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        for flag in (*FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        driver = webdriver.Chrome(options=options, service=service)
        try:
            yield Browser(driver)
        finally:
            driver.quit()


@pytest.fixture(scope="session")
def page_file(tmp_path_factory):
    """The page as the command writes it."""
    path = tmp_path_factory.mktemp("page") / "swim.html"
    assert main(["page", "swim5-value-gradient", "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="session")
def opened(browser, page_file):
    browser.open(page_file)
    return browser


@pytest.fixture
def another_page(opened, page_file):
    """The browser, to open another file with; the page is there again after the test."""
    yield opened
    opened.open(page_file)


@pytest.fixture
def page(opened):
    """The page at the start of its life: five links, value gradients alone, paused."""
    opened.emulate("light")
    opened.resize(1280, 800)
    opened.do(
        "document.getElementById('as-learned').click();"
        "swimmer.pause(); swimmer.choose('swim5-value-gradient'); swimmer.setTarget(0);"
    )
    opened.drawn()
    return opened
