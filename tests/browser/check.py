"""Goes through all pages of a server with a real browser, and tells what is wrong with them.

python check.py CHROMIUM ORIGIN PAGE REPLAY TEAM ORGANISER: the browser, the origin of a server with runs whose replays
everybody may see, the page of a person who is about to play, a replay whose agent had ears, and the tokens of a team
and of an organiser.
"""

from __future__ import annotations

import sys
import time

from playwright.sync_api import sync_playwright

import ears
import keyboard
import links
import office
import pages

PAGES_OF_A_KIND = 2


def main(chromium: str, origin: str, page: str, replay: str, team: str, organiser: str) -> int:
    """Checks everything; gives back the exit code."""
    begun = time.monotonic()
    site = links.crawl(origin)
    addresses = site.pages(PAGES_OF_A_KIND)
    print(f"{len(site.documents)} addresses, {len(addresses)} pages to look at", flush=True)
    found = site.broken
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium)
        found += pages.check(browser, origin, addresses)
        found += office.check(browser, origin, team, organiser)
        for width in pages.WIDTHS_PX:
            found += keyboard.journey(browser, origin, width)
        found += keyboard.play(browser, page)
        found += ears.check(browser, replay)
        browser.close()
    print("\n".join(found) or "nothing is wrong", f"{time.monotonic() - begun:.0f} s", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
