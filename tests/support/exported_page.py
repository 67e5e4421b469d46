"""An exported organ in a real Chromium, from its file, offline."""

from contextlib import contextmanager

from support.browser import LAPTOP, PHONE
from support.touch_page import Touched

DEVICES = [("laptop", "light"), ("phone", "dark")]


@contextmanager
def opened_offline(browser, file, device, scheme):
    """The page on a device of DEVICES. It has no problems, and asks for nothing but itself."""
    how = {"viewport": PHONE, "has_touch": True, "is_mobile": True} if device == "phone" else {"viewport": LAPTOP}
    context = browser.new_context(color_scheme=scheme, **how)
    context.set_offline(True)
    page = context.new_page()
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    mine = Touched(None, page)
    mine.device = device
    mine.open(file.as_uri())
    yield mine
    assert mine.problems == []
    assert [url for url in requests if not url.startswith(("blob:", "data:"))] == [file.as_uri()]
    context.close()
