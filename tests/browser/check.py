"""Checks of all pages of a server in a real browser; prints the defects.

python check.py CHROMIUM ORIGIN PAGE REPLAY TEAM ORGANISER: the browser, a server with runs and
public replays, the play page before a run, a replay with sound, and the tokens of a team and an
organiser.
"""

from __future__ import annotations

import sys
import time

from playwright.sync_api import sync_playwright

import account
import keyboard
import links
import pages
import replay_sound

PAGES_OF_A_KIND = 2


def main(chromium: str, origin: str, page: str, replay: str, team: str, organiser: str) -> int:
    """Runs all checks; returns the exit code."""
    begun = time.monotonic()
    site = links.crawl(origin)
    addresses = site.pages(PAGES_OF_A_KIND)
    print(f"{len(site.documents)} addresses, {len(addresses)} pages to check", flush=True)
    found = site.broken
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium)
        found += pages.check(browser, origin, addresses)
        found += account.check(browser, origin, team, organiser)
        for width in pages.WIDTHS_PX:
            found += keyboard.journey(browser, origin, width)
        found += keyboard.play(browser, page)
        found += replay_sound.check(browser, replay)
        browser.close()
    print("\n".join(found) or "no defects", f"{time.monotonic() - begun:.0f} s", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
