#!/usr/bin/env python3
"""Checks a page of s3-report: elements are nested properly, ids are unique, nothing is loaded.

usage: check_page.py PAGE
"""

import html.parser
import pathlib
import sys

VOID = {"meta", "img", "input"}
# The scripts that a page has, besides its data.
NUM_SCRIPTS = 2


class Checker(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.ids, self.errors, self.scripts = [], set(), [], 0

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag not in VOID and not (tag in ("rect", "polyline")):
            self.open.append(tag)
        if tag == "script" and "type" not in attrs:
            self.scripts += 1
        for name, value in attrs.items():
            if name == "id":
                if value in self.ids:
                    self.errors.append(f"id {value} is there twice")
                self.ids.add(value)
            if name in ("src", "href") and not value.startswith("data:"):
                self.errors.append(f"<{tag}> loads {value[:80]}")
            if name.startswith("on"):
                self.errors.append(f"<{tag}> has {name}")

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open[-1] != tag:
            self.errors.append(f"</{tag}> closes {self.open[-1:] or 'nothing'} at {self.getpos()}")
        else:
            self.open.pop()


def main():
    text = pathlib.Path(sys.argv[1]).read_bytes().decode("utf-8")  # Strictly.
    checker = Checker()
    checker.feed(text)
    checker.close()
    errors = checker.errors + [f"<{tag}> is not closed" for tag in checker.open]
    if checker.scripts != NUM_SCRIPTS:
        errors.append(f"{checker.scripts} scripts, expected {NUM_SCRIPTS}")
    if not text.startswith("<!DOCTYPE html>"):
        errors.append("no document type")
    print("\n".join(errors))
    sys.exit(1 if errors else 0)


if __name__ == "__main__":
    main()
