"""A page whose room goes on with another host, behind one address."""

from support.browser import LAPTOP
from support.example_organs import organ
from support.registries import registry_server
from support.several_hosts import ServingHost, balancer
from support.touch_page import Touched

import palpate as pp


def test_a_page_of_a_host_without_power_is_served_by_another_one(browser, tmp_path):
    """No connection is closed. The page shows no force meanwhile, comes back by itself, and is felt there."""
    (tmp_path / "registry").mkdir()
    pp.write_tissue(tmp_path / "kidney.vtu", organ(9))
    with registry_server("redis", tmp_path / "registry") as server:
        first, second = (ServingHost(tmp_path / name, tmp_path / "kidney.vtu", server.address) for name in ("a", "b"))
        ports = [first.port]
        try:
            with balancer(ports) as address:
                context = browser.new_context(viewport=LAPTOP)
                page = Touched(None, context.new_page())
                page.open(f"{address}?token={second.tokens['trainee']}")
                page.wait("palpate.frame.tick > 0")
                press(page)
                ports[:] = [second.port]
                first.silence()
                page.wait("document.getElementById('status').textContent.includes('does not answer')")
                assert page.see("document.getElementById('force').textContent") == "0.00"
                page.wait("document.getElementById('status').classList.contains('good')", 60)
                page.page.mouse.up()
                page.until_home()
                assert second.rooms()
                press(page)
                context.close()
        finally:
            first.lose()
            second.end()


def press(page):
    """Holds the pointer down on the organ until the force is there."""
    page.page.mouse.move(*page.place(0.5, 0.45))
    page.page.mouse.down()
    page.wait("palpate.frame.contact[0] === 1 && Number(document.getElementById('force').textContent) > 0.02")
