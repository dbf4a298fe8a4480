"""Checks of the leaderboard, run, replay and play pages with a keyboard only."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from pages import HEIGHT_PX, WIDTHS_PX, Watch, look

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

MOST_STOPS = 400
STEP = "#replay [data-tell=step]"

FOCUS = """async () => {
  // The page scrolls to the focused element in the next frame.
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const e = document.activeElement;
  const style = getComputedStyle(e);
  const ring = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0;
  const marked = ring || style.boxShadow !== "none";
  const spots = [...e.getClientRects()].flatMap((r) => [0.02, 0.1, 0.5, 0.9, 0.98].flatMap((x) => [0.1, 0.5, 0.9].map(
    (y) => [r.left + x * r.width, r.top + y * r.height])));
  const seen = spots.some(([x, y]) => e.contains(document.elementFromPoint(x, y)));
  const outside = e === document.body;
  // A sound player has several stops.
  const again = !outside && window.stops.includes(e) && !(e.matches("audio") && window.stops.at(-1) === e);
  window.stops.push(e);
  return { again, fine: outside || (marked && seen), marked, what: e.outerHTML.slice(0, 120) };
}"""
"""The focused element's visibility (WCAG 2.4.11), and whether it had the focus before."""

UNREACHED = """() => {
  const can = "a[href], button, input:not([type=hidden]), select, summary, [tabindex='0']";
  const shown = [...document.querySelectorAll(can)].filter((e) => e.checkVisibility() && !e.disabled);
  return shown.filter((e) => !window.stops.includes(e)).map((e) => e.outerHTML.slice(0, 120));
}"""


def stops(page: Page) -> list[str]:
    """Visits all Tab stops; returns invisible and missing stops."""
    page.evaluate("() => { window.stops = []; }")
    found = []
    for _ in range(MOST_STOPS):
        page.keyboard.press("Tab")
        stop = cast("dict[str, object]", page.evaluate(FOCUS))
        if stop["again"]:
            break
        if not stop["fine"]:
            found.append(f"the focus is {'hidden' if stop['marked'] else 'not marked'}: {stop['what']}")
    found += [f"Tab does not reach {what}" for what in cast("list[str]", page.evaluate(UNREACHED))]
    return found


def tab_to(page: Page, selector: str) -> None:
    """Presses Tab until the selected element has the focus."""
    for _ in range(MOST_STOPS):
        page.keyboard.press("Tab")
        if page.evaluate("(selector) => document.activeElement.matches(selector)", selector):
            return
    raise AssertionError(f"Tab does not reach {selector} on {page.url}")


def follow(page: Page, selector: str) -> None:
    """Opens a link with Tab and Enter."""
    tab_to(page, selector)
    with page.expect_navigation():
        page.keyboard.press("Enter")


def expect_step(page: Page, step: int, key: str) -> list[str]:
    """Presses a key in a replay; returns a finding if another step than `step` is shown."""
    page.keyboard.press(key)
    shown = int(page.inner_text(STEP))
    return [] if shown == step else [f"{key} in the replay: expected step {step}, got {shown}"]


def replay(page: Page) -> list[str]:
    """Plays, pauses and seeks in a replay."""
    tab_to(page, "#replay #t")
    last = int(page.get_attribute("#replay", "data-last") or 0)
    found = []
    for key, step in [("Home", 0), ("ArrowRight", 1), ("Shift+ArrowRight", 11), ("ArrowLeft", 10), ("End", last)]:
        found += expect_step(page, step, key)
    page.keyboard.press("Home")
    page.keyboard.press("Space")
    page.wait_for_function("(step) => Number(document.querySelector(step).innerText) >= 2", arg=STEP)
    page.keyboard.press("Space")
    halted = page.inner_text(STEP)
    page.wait_for_timeout(600)
    return found + ([] if page.inner_text(STEP) == halted else ["Space does not pause the replay"])


def journey(browser: Browser, origin: str, width: int) -> list[str]:
    """Follows links from a leaderboard to a replay, and plays it."""
    context = browser.new_context(viewport={"width": width, "height": HEIGHT_PX})
    page = context.new_page()
    page.goto(f"{origin}/leaderboard")
    page.keyboard.press("Tab")
    skips = page.evaluate("() => document.activeElement.matches('.skip')")
    page.keyboard.press("Enter" if skips else "Tab")
    skipped = page.evaluate("() => document.activeElement.id === 'main'")
    found = [] if skipped else ["the first Tab stop does not skip to the content"]
    for link in ["main a[href$='order=unordered']", "main tbody th a[href^='/runs/']", "main a[href*='/episodes/']"]:
        follow(page, link)
        found += [f"{page.url}, {width} px: {stop}" for stop in stops(page)]
    page.goto(page.url)
    found += replay(page)
    context.close()
    return found


def play(browser: Browser, address: str) -> list[str]:
    """Plays some steps and a Submit as a person; checks the page before the run and during it."""
    context = browser.new_context(viewport={"width": WIDTHS_PX[0], "height": HEIGHT_PX})
    page = context.new_page()
    watch = Watch(page, address)
    page.goto(address)
    page.wait_for_selector("#waiting:not([hidden])")
    found = look(page) + stops(page)
    page.reload()
    tab_to(page, "#next")
    page.keyboard.press("Enter")
    page.wait_for_selector("#playing:not([hidden])", timeout=120_000)
    left = page.inner_text("#submits")
    for key in ["ArrowUp", "ArrowLeft", "ArrowRight", "Enter"]:
        before = page.inner_text("#step")
        page.keyboard.press(key)
        page.wait_for_function("(before) => document.querySelector('#step').innerText !== before", arg=before)
    if page.inner_text("#submits") == left:
        found.append("Enter does not submit")
    found += look(page) + stops(page) + watch.take()
    context.close()
    return [f"{address}: {finding}" for finding in found]
