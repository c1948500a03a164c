"""HTML as the standard library reads it, and texts as a page shows them."""

from html.parser import HTMLParser

VOID = {"meta", "link", "br", "img", "hr", "input"}


class Html(HTMLParser):
    """What a page consists of; unclosed tags, duplicate ids and comments fail."""

    def __init__(self, html):
        super().__init__()
        self.open = []
        self.ids = set()
        self.tags = set()
        self.attributes = set()
        self.text = ""
        self.links = set()
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        for name, value in attrs:
            if name == "id":
                assert value not in self.ids, f"id {value} twice"
                self.ids.add(str(value))
            if name == "href":
                self.links.add(str(value))
            if name == "clip-path":
                self.links.add(str(value)[4:-1])
        if tag not in VOID:
            self.open.append(tag)

    def handle_data(self, data):
        self.text += data

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_comment(self, data):
        raise AssertionError(f"comment {data}")


def shown(text):
    """The characters that a reader sees of a text."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )
