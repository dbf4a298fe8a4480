"""Checks of every page, in both themes, wide and narrow."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import TYPE_CHECKING, Literal, cast
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

AXE = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]
VIOLATIONS = f"""async () => {{
  const {{ violations }} = await axe.run({{ runOnly: {json.dumps(RULES)}, resultTypes: ["violations"] }});
  return violations.map(({{ id, nodes }}) =>
    `${{id}}, ${{nodes.length}} times, first ${{nodes[0].html.slice(0, 160)}}: ${{nodes[0].failureSummary}}`);
}}"""
"""Violations of WCAG rules, found by axe."""
WIDTHS_PX = (1280, 360)
THEMES: dict[int, tuple[Literal["light", "dark"], ...]] = {1280: ("light", "dark"), 360: ("dark",)}
"""Themes per width; the style sheet has no rule for a combination of both."""
HEIGHT_PX = 800

SIDEWAYS = """() => {
  const root = document.documentElement;
  const wide = root.scrollWidth > innerWidth ? [`the page, by ${root.scrollWidth - innerWidth} px`] : [];
  const scrolls = (e) => e.scrollWidth > e.clientWidth + 1 && /auto|scroll/.test(getComputedStyle(e).overflowX);
  const may = (e) => e.matches("pre") || e.querySelector("table") !== null;
  const others = [...document.querySelectorAll("body *")].filter((e) => scrolls(e) && !may(e));
  return wide.concat(others.map((e) => e.outerHTML.slice(0, 80)));
}"""
"""Elements wider than the window, except tables and code with their own scroll bars."""

COLOUR_ALONE = """() => {
  const looks = (e) => [getComputedStyle(e).strokeDasharray, e.getAttribute("d") ?? ""].join();
  const lines = [...document.querySelectorAll("svg.curves")].flatMap((plot) => {
    const dashes = new Map([...plot.querySelectorAll("path[class^=line]")].map(
      (line) => [line.getAttribute("class"), getComputedStyle(line).strokeDasharray]));
    return new Set(dashes.values()).size < dashes.size ? ["lines of a plot with the same dashes"] : [];
  });
  const signs = (selector) => new Set([...document.querySelectorAll(selector)].map(looks));
  const right = signs(".submit.right path");
  const claims = [...signs(".submit:not(.right) path")].some((sign) => right.has(sign));
  const words = [...document.querySelectorAll(".good, .bad")].filter((e) => e.textContent.trim() === "");
  return lines.concat(claims ? ["correct and wrong Submits with the same sign"] : [],
    words.map((e) => `no text or sign: ${e.outerHTML.slice(0, 80)}`));
}"""
"""Elements distinguished only by colour."""


class Watch:
    """A recorder for a page's requests to other origins, console errors and script errors."""

    def __init__(self, page: Page, origin: str) -> None:
        self.found: list[str] = []
        page.on("request", lambda request: self._on_request(request.url, origin))
        page.on("console", lambda line: self._on_console(line.type, line.text))
        page.on("pageerror", lambda error: self.found.append(f"script error: {error}"))

    def _on_request(self, url: str, origin: str) -> None:
        if urlsplit(url)[:2] != urlsplit(origin)[:2] and not url.startswith(("data:", "blob:")):
            self.found.append(f"request to another origin: {url}")

    def _on_console(self, severity: str, text: str) -> None:
        if severity in ("error", "warning"):
            self.found.append(f"console {severity}: {text}")

    def take(self) -> list[str]:
        """Returns and clears the findings."""
        found, self.found = self.found, []
        return found


def look(page: Page) -> list[str]:
    """Checks the current page in both themes, wide and narrow."""
    found = [f"distinguished only by colour: {what}" for what in cast("list[str]", page.evaluate(COLOUR_ALONE))]
    page.evaluate(AXE)
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": HEIGHT_PX})
        for theme in THEMES[width]:
            page.emulate_media(color_scheme=theme)
            found += [f"{theme}, {width} px: {broken}" for broken in cast("list[str]", page.evaluate(VIOLATIONS))]
        found += [f"{width} px: horizontal scrolling: {what}" for what in cast("list[str]", page.evaluate(SIDEWAYS))]
    return found


def check(browser: Browser, origin: str, addresses: list[str]) -> list[str]:
    """Checks the page at every address, and the page for unknown addresses."""
    context = browser.new_context(viewport={"width": WIDTHS_PX[0], "height": HEIGHT_PX})
    page = context.new_page()
    found = visit(page, Watch(page, origin), addresses)
    found += [f"unknown address: {finding}" for finding in missing(page, origin)]
    context.close()
    return found


def visit(page: Page, watch: Watch, addresses: list[str]) -> list[str]:
    """Opens every address in a tab and checks the page."""
    found = []
    for address in addresses:
        page.goto(address)
        page.evaluate("() => document.querySelectorAll('details').forEach((e) => (e.open = true))")
        findings = watch.take() + look(page) + watch.take()
        found += [f"{address}: {finding}" for finding in findings]
    return found


def missing(page: Page, origin: str) -> list[str]:
    """Checks the page for unknown addresses."""
    answer = page.goto(f"{origin}/nowhere")
    status = answer.status if answer else None
    return look(page) + ([] if status == 404 else [f"expected status 404, got {status}"])
