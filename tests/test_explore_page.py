"""The page in a real browser that can reach nothing but this machine, served by the command."""

import http.client
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

from experiment import Experiment

CHROMIUM = shutil.which("chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
]
FIRST_POUR = 240_000  # ms, where kernels are compiled
LONG = 60_000  # ms, on a machine that has much else to do
MODELS = ("lattice", "continuum")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on this machine")


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """Its address, by the command as a user gives it."""
    command = [str(Path(sys.executable).parent / "stratify"), "explore", "--port=0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        told = process.stdout.readline() if process.stdout else ""
        found = re.search(r"http://\S+/", told)
        assert found, told
        yield found[0]
        process.terminate()
        assert process.wait(30) == 0


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, headless=True, args=ARGUMENTS
        )
        yield browser
        browser.close()


class Visit(NamedTuple):
    """A page, what it asked for, and what its console complained of."""

    page: Page
    requests: list[str]
    complaints: list[str]

    def number(self, model: str, name: str) -> Locator:
        """What is told of the pile of a model: regime, wavelength or kinks."""
        return self.page.get_by_label(model, exact=True).locator(f".{name}")

    def slide(self, name: str, key: str) -> None:
        """Move a slider with the keyboard, once it can be moved."""
        self.page.locator(f".{name} .noUi-target:not([disabled])").wait_for()
        self.page.locator(f".{name} .noUi-handle").press(key)

    @property
    def clock(self) -> Locator:
        """Where the page says what time it is."""
        return self.page.locator(".clock")

    def time(self) -> float:
        """The time [s] that the page says."""
        told = re.match(r"time: ([\d.]+) s of 180 s", self.clock.inner_text())
        assert told
        return float(told[1])


def open_page(browser: Browser, server: str) -> Visit:
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.set_default_timeout(LONG)
    expect.set_options(timeout=LONG)
    visit = Visit(page, [], [])
    page.on("request", lambda request: visit.requests.append(request.url))
    page.on("websocket", lambda ws: visit.requests.append(ws.url))
    page.on("pageerror", lambda error: visit.complaints.append(str(error)))
    page.on(
        "console",
        lambda told: (
            visit.complaints.append(told.text) if told.type in ("error", "warning") else None
        ),
    )
    page.goto(server)
    expect(visit.number("lattice", "regime")).to_have_text("not yet", timeout=FIRST_POUR)
    return visit


@pytest.fixture
def visit(browser: Browser, server: str) -> Iterator[Visit]:
    """A visit; after it no request may have left this machine, and the console be clean."""
    visit = open_page(browser, server)
    yield visit
    visit.page.context.close()
    hosts = {urlsplit(url.removeprefix("blob:")).hostname for url in visit.requests}
    assert hosts == {"127.0.0.1"}
    assert visit.complaints == []


def test_it_opens_with_both_models_and_delta(visit: Visit) -> None:
    expect(visit.page.locator(".delta .value")).to_have_text("δ = +0.32")
    for model in MODELS:
        expect(visit.number(model, "wavelength")).to_have_text("not yet")
    assert any(url.startswith("ws://127.0.0.1") for url in visit.requests)


def test_it_plays_and_pause_stops_it(visit: Visit) -> None:
    assert visit.time() == 0.0
    visit.page.get_by_role("button", name="Play").click()
    expect(visit.clock).not_to_contain_text("time: 0 s")
    visit.page.get_by_role("button", name="Pause").click()
    expect(visit.page.get_by_role("button", name="Play")).to_be_visible()
    stopped = visit.time()
    visit.page.wait_for_timeout(500)
    assert 0.0 < visit.time() == stopped < 180.0


def test_delta_below_zero_ends_the_layers_and_above_they_are_back(visit: Visit) -> None:
    visit.slide("time", "End")
    for model, wavelength in (("lattice", "0.856"), ("continuum", "1.216")):
        expect(visit.number(model, "regime")).to_have_text("layers")
        expect(visit.number(model, "wavelength")).to_contain_text(wavelength)
        expect(visit.number(model, "kinks")).to_contain_text("±")
    visit.slide("angle_2", "Home")
    expect(visit.page.locator(".delta .value")).to_have_text("δ = −0.40")  # noqa: RUF001
    for model in MODELS:
        expect(visit.number(model, "regime")).to_have_text("segregated")
        expect(visit.number(model, "wavelength")).to_have_text("none")
        expect(visit.number(model, "kinks")).to_have_text("none")
    visit.slide("angle_2", "End")
    for model in MODELS:
        expect(visit.number(model, "regime")).to_have_text("layers")
        expect(visit.number(model, "wavelength")).to_contain_text("±")


def test_what_cannot_be_poured_is_said_in_a_line_and_the_piles_stay(visit: Visit) -> None:
    visit.slide("time", "End")
    expect(visit.number("continuum", "regime")).to_have_text("layers")
    visit.slide("psi", "End")
    complaint = visit.page.locator(".complaint")
    expect(complaint).to_contain_text("mixture.psi = 0.6: it makes a repose slope of")
    expect(visit.number("continuum", "regime")).to_have_text("layers")
    visit.slide("psi", "Home")
    expect(complaint).not_to_be_visible()


def test_a_set_up_is_saved_as_the_command_line_takes_it(visit: Visit, tmp_path: Path) -> None:
    visit.slide("angle_2", "End")
    expect(visit.page.locator(".delta .value")).to_have_text("δ = +1.24")
    with visit.page.expect_download() as download:
        visit.page.get_by_text("Save set-up (TOML)").click()
    saved = tmp_path / "mine.toml"
    download.value.save_as(saved)
    assert Experiment.from_file(saved).title == "Glass beads and sugar, changed"


def test_a_prediction_is_told_right_from_wrong(visit: Visit) -> None:
    page, score = visit.page, visit.page.locator(".scores")
    page.locator("select").first.select_option("Makse 1997, section V: stratification")
    expect(page.locator(".delta .value")).to_have_text("δ = +0.25")
    page.get_by_role("button", name="Predict, then run").click()
    run = page.get_by_role("button", name="Run", exact=True)
    for model in MODELS:
        expect(visit.number(model, "wavelength")).to_have_text("hidden")
    expect(run).to_be_disabled()
    page.get_by_label("wavelength (cm), a guess").fill("3")
    page.get_by_label("wavelength (cm), a guess").press("Enter")
    page.get_by_label("layers").check()
    run.click()
    page.get_by_role("button", name="Pause").click()
    visit.slide("time", "End")
    expect(score).to_contain_text("Score: 3 of 4")
    continuum = page.get_by_label("continuum", exact=True).locator(".verdict")
    expect(continuum).to_contain_text("✓ layers")
    expect(continuum).to_contain_text("✓ 3 cm")
    expect(page.get_by_label("lattice", exact=True).locator(".verdict")).to_contain_text("✗ 3 cm")
    visit.slide("angle_2", "Home")
    expect(visit.number("continuum", "regime")).to_have_text("hidden")
    run.click()
    page.get_by_role("button", name="Pause").click()
    visit.slide("time", "End")
    expect(score).to_contain_text("Score: 3 of 6")
    expect(continuum).to_contain_text("✗ layers")


def test_each_visitor_has_a_desk_of_their_own(visit: Visit, browser: Browser, server: str) -> None:
    visit.slide("angle_2", "Home")
    expect(visit.page.locator(".delta .value")).not_to_have_text("δ = +0.32")
    other = open_page(browser, server)
    expect(other.page.locator(".delta .value")).to_have_text("δ = +0.32")
    other.page.context.close()


def test_only_this_machine_reaches_it(server: str) -> None:
    """127.0.0.2 is this machine, too: who listens everywhere would answer there."""
    port = urlsplit(server).port
    with socket.create_connection(("127.0.0.1", port), timeout=10):
        pass
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", port), timeout=10)


@pytest.mark.parametrize(("origin", "status"), [("http://elsewhere.example", 403), (None, 101)])
def test_a_page_from_elsewhere_cannot_talk_to_it(
    server: str, origin: str | None, status: int
) -> None:
    connection = http.client.HTTPConnection(urlsplit(server).netloc, timeout=30)
    shown = http.client.HTTPConnection(urlsplit(server).netloc, timeout=30)
    shown.request("GET", "/")
    token = re.search(r'"token":"([^"]+)"', shown.getresponse().read().decode())
    assert token
    headers = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": "c3RyYXRpZnkgc3RyYXRpZg==",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Protocol": f"bokeh, {token[1]}",
        "Origin": origin or server.rstrip("/"),
    }
    connection.request("GET", "/ws", headers=headers)
    assert connection.getresponse().status == status
    connection.close()
    shown.close()
