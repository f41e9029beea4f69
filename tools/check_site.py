"""Check the built site: links within it lead somewhere, nothing comes from outside.

python tools/check_site.py build/docs
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "audio": "src",
    "video": "src",
    "object": "data",
    "embed": "src",
}
"""Element -> attribute whose target a browser loads; of `link`, styles and icons."""


class Page(HTMLParser):
    """Anchors and targets of one page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = {"", "top"}
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what an element is called, links to and loads."""
        values = {name: value or "" for name, value in attrs}
        self.anchors.add(values.get("id", ""))
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and values.get("rel") in ("stylesheet", "icon", "preload", "preconnect"):
            self.loads.append(values["href"])
        if LOADED.get(tag, "") in values:
            self.loads.append(values[LOADED[tag]])


def faults(site: Path) -> Iterator[str]:
    """Yield what is wrong with the pages of a site."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    for path, page in pages.items():
        name = path.relative_to(site)
        for target in page.links + page.loads:
            address = urlsplit(target)
            if address.scheme or address.netloc:
                if target in page.loads and address.scheme != "data":
                    yield f"{name}: loads {target}"
                continue
            file = (path.parent / unquote(address.path)).resolve() if address.path else path
            if not file.is_file():
                yield f"{name}: no file {target}"
            elif file in pages and unquote(address.fragment) not in pages[file].anchors:
                yield f"{name}: no anchor {target}"
    for path in site.rglob("*.css"):
        text = path.read_text(encoding="utf-8")
        for outside in ("url(http", "url(//", "@import"):
            if outside in text:
                yield f"{path.relative_to(site)}: loads from outside ({outside})"


def main() -> None:
    """Print the faults of a site and end with 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=Path)
    lines = sorted(set(faults(parser.parse_args().site.resolve())))
    print("\n".join(lines), end="\n" if lines else "")
    sys.exit(bool(lines))


if __name__ == "__main__":
    main()
