"""A crawl of all pages linked from the front page, with a check of every link."""

from __future__ import annotations

import re
from collections import Counter, deque
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import TYPE_CHECKING
from urllib.error import HTTPError
from urllib.parse import parse_qs, unquote, urldefrag, urljoin, urlsplit
from urllib.request import urlopen

if TYPE_CHECKING:
    from collections.abc import Iterator

READ_OF_A_KIND = 8
"""Pages per kind with followed links; further pages are only requested."""
NAMES = re.compile(r"(?<=/)(?P<route>runs|episodes|leaderboard|phases|embed|eyes|ears)/[^/]+|(?<=/)(?P<docs>docs)/.+")
POINTERS = ("href", "src", "action")


@dataclass
class Document:
    """The response to a request."""

    status: int
    is_page: bool = False
    links: list[str] = field(default_factory=list)
    anchors: set[str] = field(default_factory=set)


@dataclass
class Site:
    """Requested addresses without anchors, in order of discovery."""

    documents: dict[str, Document] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def pages(self, of_a_kind: int) -> list[str]:
        """Returns page addresses, at most `of_a_kind` per kind."""
        taken: Counter[str] = Counter()
        addresses = []
        for address, document in self.documents.items():
            taken[kind(address)] += document.is_page
            if document.is_page and taken[kind(address)] <= of_a_kind:
                addresses.append(address)
        return addresses


class Reader(HTMLParser):
    """A parser that collects a page's links and anchors."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Reads an element's attributes."""
        del tag
        for name, value in attrs:
            if value is not None and name in POINTERS:
                self.links.append(value)
            elif value is not None and name == "id":
                self.anchors.add(value)


def kind(address: str) -> str:
    """Returns the route and sort order of an address."""
    parts = urlsplit(address)
    route = NAMES.sub(lambda match: f"{match['route'] or match['docs']}/*", parts.path)
    return " ".join([route, *parse_qs(parts.query).get("order", [])])


def read(address: str) -> Document:
    """Requests an address and parses the page."""
    try:
        with urlopen(address, timeout=60) as answer:
            body = answer.read()
            is_page = answer.headers.get_content_type() == "text/html"
            document = Document(answer.status, is_page)
    except HTTPError as error:
        return Document(error.code)
    if is_page:
        reader = Reader()
        reader.feed(body.decode())
        document.links, document.anchors = reader.links, reader.anchors
    return document


def targets(address: str, document: Document) -> Iterator[tuple[str, str]]:
    """Yields a page's links to the same origin, with anchors."""
    for link in document.links:
        target, anchor = urldefrag(urljoin(address, link))
        if urlsplit(target)[:2] == urlsplit(address)[:2]:
            yield target, unquote(anchor)


def crawl(origin: str) -> Site:
    """Follows all links from the front page."""
    site = Site()
    waiting = deque([(f"{origin}/", "the front page")])
    kinds: Counter[str] = Counter()
    while waiting:
        address, source = waiting.popleft()
        if address in site.documents:
            continue
        document = site.documents[address] = read(address)
        if document.status != 200:
            site.broken.append(f"{address}: status {document.status}, linked from {source}")
        kinds[kind(address)] += 1
        if kinds[kind(address)] <= READ_OF_A_KIND:
            waiting.extend((target, address) for target, _ in targets(address, document))
    site.broken.extend(lost_anchors(site))
    return site


def lost_anchors(site: Site) -> list[str]:
    """Returns the links to missing anchors."""
    lost = []
    for address, document in site.documents.items():
        for target, anchor in targets(address, document):
            there = site.documents.get(target)
            if anchor and there is not None and there.is_page and anchor not in there.anchors:
                lost.append(f"{target}#{anchor}: missing anchor, linked from {address}")
    return lost
