"""What a notebook is to a widget's front end: a document, and models of what is set. Without Jupyter."""

import base64
import gzip

import numpy as np
from playwright.sync_api import Error

from palpate.server.access_control import STATIC
from support.touch_page import Touched

# A model as anywidget hands it to `render`: it also keeps what was saved, and when.
HOST = """async (code) => {
  const widget = (await import("data:text/javascript;base64," + code)).default;
  window.mounted = [];
  window.mount = (given) => {
    const bytes = Uint8Array.from(atob(given._page), (c) => c.charCodeAt(0));
    const values = { ...given, _page: new DataView(bytes.buffer) }, heard = {}, saves = [];
    const model = {
      get: (name) => values[name],
      set: (name, value) => {
        if (JSON.stringify(values[name]) === JSON.stringify(value)) return;
        values[name] = value;
        for (const listener of heard[`change:${name}`] ?? []) listener();
      },
      on: (event, listener) => (heard[event] ??= []).push(listener),
      off: (event, listener) => (heard[event] = heard[event].filter((each) => each !== listener)),
      save_changes: () => saves.push(performance.now()),
    };
    const el = document.body.appendChild(document.createElement("div"));
    mounted.push({ model, values, saves, heard, el, close: widget.render({ model, el }) });
  };
}"""


class Frame(Touched):
    """A page in a widget's frame; the pointer acts on the document around it."""

    def __init__(self, page, number):
        super().__init__(None, page)
        self.number = number
        self.frame = page.locator(".palpate-widget iframe").nth(number).element_handle().content_frame()

    def see(self, expression):
        return self.frame.evaluate(expression)

    def place(self, across=0.5, down=0.42):
        box = self.frame.locator("#view").bounding_box()
        return np.array([box["x"] + across * box["width"], box["y"] + down * box["height"]])

    def value(self, name):
        """What the model holds, as Python would read it."""
        return self.page.evaluate("([i, name]) => mounted[i].values[name]", [self.number, name])

    def give(self, name, value):
        """Sets a value of the model, as Python does."""
        self.page.evaluate("([i, name, value]) => mounted[i].model.set(name, value)", [self.number, name, value])

    def until(self, condition):
        """Until the model's values `v` meet a condition."""
        for _ in range(1800):
            if self.page.evaluate(
                f"(() => {{ const v = mounted[{self.number}].values; return Boolean({condition}) }})()"
            ):
                return
            self.page.wait_for_timeout(50)
        told = ("tool", "depth", "view", "color", "_touched", "_picked", "position", "window", "_value")
        raise AssertionError(f"never so: {condition}; values are {[(name, self.value(name)) for name in told]}")


def host(page):
    """Makes a blank page a notebook's document."""
    page.goto("about:blank")
    page.set_content("<!doctype html><html lang='en'><title>notebook</title><body></body></html>")
    page.evaluate(HOST, base64.b64encode((STATIC / "notebook.js").read_bytes()).decode())


def mount(page, html, settable, ready="Boolean(window.palpate && palpate.frame)", height=600):
    """Renders a widget for a page's HTML, and waits for it."""
    given = {"_page": base64.b64encode(gzip.compress(html.encode(), 1)).decode(), "_settable": list(settable)}
    page.evaluate("given => mount(given)", given | {"title": "organ", "height": height, "_picture": "picture"})
    number = page.evaluate("mounted.length - 1")
    return framed(page, number, ready)


def framed(page, number, ready="Boolean(window.palpate && palpate.frame)"):
    """The page in a widget's frame, when it is ready. A browser draws no frame that is out of sight."""
    page.locator(".palpate-widget iframe").nth(number).scroll_into_view_if_needed()
    for _ in range(600):
        mine = Frame(page, number)
        try:
            if mine.see(ready):
                return mine
        except Error:  # an empty document comes first, and goes
            pass
        page.wait_for_timeout(100)
    raise AssertionError("the page in the frame does not begin")
