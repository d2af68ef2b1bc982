"""A small HTML checker: elements nest and close, unique attributes, nothing from outside.

A link to a page in the same folder is allowed.
"""

from html.parser import HTMLParser

VOID = {"meta", "img", "br", "hr", "link", "input"}
CHILDREN = {
    "html": {"head", "body"},
    "table": {"thead", "tbody", "caption"},
    "thead": {"tr"},
    "tbody": {"tr"},
    "tr": {"td", "th"},
    "figure": {"img", "figcaption"},
}
PARENTS = {"td": {"tr"}, "th": {"tr"}, "tr": {"thead", "tbody"}, "figcaption": {"figure"}}
LINKS = ("src", "href", "srcset", "action", "poster", "data")


class Checker(HTMLParser):
    """Collects `problems` (strings) and the `elements` seen."""

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.stack, self.problems, self.elements = [], [], []
        self.doctype = None

    def handle_decl(self, decl):
        self.doctype = decl

    def handle_starttag(self, tag, attrs):
        parent = self.stack[-1] if self.stack else None
        if parent in CHILDREN and tag not in CHILDREN[parent]:
            self.problems.append(f"{tag} in {parent}")
        if tag in PARENTS and parent not in PARENTS[tag]:
            self.problems.append(f"{tag} in {parent}")
        names = [name for name, _ in attrs]
        if len(set(names)) < len(names):
            self.problems.append(f"{tag}: attribute twice")
        for name, value in attrs:
            beside = tag == "a" and value.endswith(".html") and "/" not in value
            if name in LINKS and not value.startswith("data:") and not beside:
                self.problems.append(f"{tag}: {name} refers to {value[:60]}")
        if tag == "img" and not dict(attrs).get("alt"):
            self.problems.append("img without alt")
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        if not self.stack or self.stack.pop() != tag:
            self.problems.append(f"</{tag}> closes nothing")


def check(text: str) -> Checker:
    """Feeds a page; its `problems` are empty if it is well formed and stands alone."""
    checker = Checker()
    checker.feed(text)
    checker.close()
    if checker.doctype != "DOCTYPE html":
        checker.problems.append("no doctype")
    checker.problems += [f"<{tag}> is not closed" for tag in checker.stack]
    for word in ("@import", "url(", "<script"):
        if word in text:
            checker.problems.append(f"{word} in the page")
    return checker
