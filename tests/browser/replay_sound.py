"""Checks of replay sound: levels without a click, quiet playback on request, synchronous with the clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from keyboard import STEP, stops
from pages import HEIGHT_PX, WIDTHS_PX, Watch, look

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

AUDIO = "#ears audio"
SOUND = """(audio) => ({ paused: audio.paused, volume: audio.volume, time: audio.currentTime,
  error: audio.error?.message, step: Number(document.querySelector("#replay [data-tell=step]").innerText) })"""


def sound(page: Page) -> dict[str, object]:
    """Returns the state of the sound and the clock."""
    return cast("dict[str, object]", page.eval_on_selector(AUDIO, SOUND))


def plays(page: Page) -> list[str]:
    """Plays the replay with sound from the start; returns differences between sound and clock."""
    before = sound(page)
    found = [] if before["paused"] else ["the sound starts without a click"]
    if cast("float", before["volume"]) > 0.3:
        found.append(f"initial volume: expected at most 0.3, got {before['volume']}")
    page.press("#t", "Home")
    page.check("#ears [data-act=sound]")
    page.click("[data-act=play]")
    page.wait_for_function("(step) => Number(document.querySelector(step).innerText) >= 4", arg=STEP)
    during = sound(page)
    page.click("[data-act=play]")
    halted = sound(page)
    if during["paused"] or during["error"]:
        found.append(f"the sound does not play: {during}")
    if abs(cast("float", during["time"]) / 0.25 - cast("int", during["step"])) > 2:
        found.append(f"the clock differs from the sound: {during}")
    if not halted["paused"]:
        found.append("the sound continues after a pause")
    return found


def check(browser: Browser, address: str) -> list[str]:
    """Checks the page and the sound of a replay."""
    context = browser.new_context(viewport={"width": WIDTHS_PX[0], "height": HEIGHT_PX})
    page = context.new_page()
    watch = Watch(page, address)
    page.goto(address)
    page.wait_for_selector("#ears [data-level=left]", timeout=60_000)
    found = look(page) + plays(page)
    page.reload()
    page.wait_for_selector("#ears [data-level=left]", timeout=60_000)
    found += stops(page) + watch.take()
    context.close()
    return [f"{address}: {finding}" for finding in found]
