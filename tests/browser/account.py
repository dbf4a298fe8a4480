"""Checks of the pages after sign-in; forms are submitted with the keyboard."""

from __future__ import annotations

from typing import TYPE_CHECKING

from keyboard import follow, stops, tab_to
from pages import HEIGHT_PX, WIDTHS_PX, Watch, look, visit

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ORGANISERS = ["", "/teams", "/runs", "/audit", "/health"]
"""Paths of the organiser pages, below `/organise`."""


def submit(page: Page, button: str) -> None:
    """Presses a button with Tab and Enter."""
    tab_to(page, button)
    with page.expect_navigation():
        page.keyboard.press("Enter")


def sign_in(page: Page, origin: str, token: str) -> None:
    """Signs in from the front page."""
    page.goto(f"{origin}/")
    follow(page, "nav a[href='/sign-in']")
    tab_to(page, "input[name=token]")
    page.keyboard.type(token)
    with page.expect_navigation():
        page.keyboard.press("Enter")


def expect(page: Page, words: str) -> list[str]:
    """Returns a finding if the page does not contain `words`."""
    return [] if words in page.inner_text("main") else [f"{page.url} does not contain '{words}'"]


def team(page: Page, watch: Watch, origin: str) -> list[str]:
    """Issues a token as a team, and signs out."""
    found = visit(page, watch, [f"{origin}/me"]) + stops(page)
    page.goto(f"{origin}/me")
    tab_to(page, "input[name=name]")
    page.keyboard.type("by keyboard")
    submit(page, "button[value=issue]")
    found += expect(page, "shown only once") + look(page)
    page.goto(f"{origin}/me")
    found += expect(page, "by keyboard")
    submit(page, "form[action='/sign-out'] button")
    page.goto(f"{origin}/me")
    return found + ([] if "/sign-in" in page.url else ["the sign-out has no effect"])


def organiser(page: Page, watch: Watch, origin: str) -> list[str]:
    """Visits all organiser pages, and pauses and resumes a phase."""
    found = visit(page, watch, [f"{origin}/organise{below}" for below in ORGANISERS])
    for tab in ["/organise", "/organise/runs"]:
        page.goto(f"{origin}{tab}")
        follow(page, f"tbody th a[href^='{tab}/']")
        found += visit(page, watch, [page.url]) + stops(page)
    page.goto(f"{origin}/organise")
    follow(page, "tbody th a")
    tab_to(page, "input[name=reason]")
    page.keyboard.type("the roof leaks")
    submit(page, "button[value=pause]")
    found += expect(page, "is paused") + look(page)
    submit(page, "button[value=resume]")
    return found + expect(page, "is open")


def check(browser: Browser, origin: str, team_token: str, organiser_token: str) -> list[str]:
    """Signs in as a team and as an organiser."""
    found = []
    for token, journey in [(team_token, team), (organiser_token, organiser)]:
        context = browser.new_context(viewport={"width": WIDTHS_PX[0], "height": HEIGHT_PX})
        page = context.new_page()
        watch = Watch(page, origin)
        sign_in(page, origin, token)
        found += journey(page, watch, origin) + watch.take()
        context.close()
    return found
