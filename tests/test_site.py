"""The site is built without a warning, and its pages work in a browser."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

pytestmark = pytest.mark.site
sphinx = pytest.importorskip("sphinx", reason="`make docs` installs what builds the site")

ROOT = Path(__file__).parents[1]
SITE = ROOT / "build" / "site"
BROWSERS = "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"


@pytest.fixture(scope="module")
def site() -> Iterator[str]:
    """The address of the site, built with warnings as errors, on this machine."""
    made = subprocess.run(
        ["make", "docs", f"PYTHON={sys.executable}"], cwd=ROOT, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    handler = partial(QuietHandler, directory=SITE)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files without a line for each."""

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    """A page of a browser in which no script fails."""
    found = [path for name in BROWSERS if (path := shutil.which(name))]
    if not found and "CI" not in os.environ:
        pytest.skip("there is no Chromium: apt-get install chromium-headless-shell")
    assert found, "there is no Chromium"
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=found[0], args=["--no-sandbox"])
        opened = browser.new_page()
        failed: list[str] = []
        opened.on("pageerror", lambda error: failed.append(str(error)))
        yield opened
        browser.close()
        assert not failed


def visit(page: Any, address: str) -> None:
    """Open a page of the site, all of whose pictures must load."""
    page.goto(address)
    missing = "pictures => pictures.filter(p => p.complete && !p.naturalWidth).map(p => p.src)"
    assert page.eval_on_selector_all("img", missing) == []


def follow(page: Any, link: Any) -> None:
    """Click a link, and wait for the page it leads to: a count of elements does not wait."""
    with page.expect_navigation():
        link.click()


def test_the_start_page_shows_pictures_and_leads_on(site, page):
    visit(page, f"{site}/index.html")
    assert page.locator("article img").count() >= 2
    follow(page, page.locator("header").get_by_text("Gallery").first)
    assert page.locator(".sphx-glr-thumbcontainer").count() >= 10


def test_a_script_of_the_gallery_has_a_picture_and_a_download(site, page):
    visit(page, f"{site}/gallery/index.html")
    follow(page, page.locator(".sphx-glr-thumbcontainer a").first)
    assert page.locator("article img").count() >= 1
    links = page.locator(".sphx-glr-download a")
    names = [links.nth(number).get_attribute("href") for number in range(links.count())]
    assert {Path(name).suffix for name in names} >= {".py", ".ipynb"}


def test_the_search_finds_a_function(site, page):
    visit(page, f"{site}/search.html?q=vibrate")
    page.wait_for_selector("#search-results li a")
    found = page.locator("#search-results li a").all_inner_texts()
    assert any("vibrate" in title for title in found), found


def test_the_reference_states_parameters_and_shows_the_source(site, page):
    visit(page, f"{site}/reference/generated/tactile_fem.scan.html")
    assert "Results folder" in page.locator("dl.field-list").first.inner_text()
    follow(page, page.get_by_text("[source]").first)
    assert "def scan(" in page.locator("pre").first.inner_text()


def test_equations_are_typeset_without_a_network(site, page):
    visit(page, f"{site}/how/theory.html")
    page.wait_for_selector("mjx-container")
    assert page.locator("mjx-container").count() > 20


def test_the_site_is_dark_if_asked_to_be(site, page):
    page.emulate_media(color_scheme="dark")
    visit(page, f"{site}/index.html")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert max(map(int, re.findall(r"\d+", ground)[:3])) < 80
