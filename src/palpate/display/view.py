"""Opens images: as a widget in a notebook, else from a server on the loopback interface."""

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from palpate.display.notebook import in_notebook, require_extra
from palpate.scans.scan import Scan
from palpate.server.access_control import check_page
from palpate.server.loopback_server import announce, loopback_socket, show, shutdown_requests
from palpate.server.view import image_payloads, serving_images
from palpate.volumes.volume import Volume

if TYPE_CHECKING:
    from palpate.display.view_widget import ViewWidget


def view(
    shown: Volume | Scan,
    other: Volume | Scan | None = None,
    *,
    water: float | None = None,
    titles: Sequence[str] = ("A", "B"),
    port: int | None = None,
    open_browser: bool = True,
) -> "ViewWidget | None":
    """Open a volume or a scan, or two side by side: in a notebook as a widget, elsewhere in a browser.

    In a notebook the page holds the values, without a server, unless `port` is given; large images are coarser there, and the
    page says so. Elsewhere it is served on the loopback interface, until Ctrl-C.

    Parameters
    ----------
    shown : Volume or Scan
        What to show.
    other : Volume or Scan, optional
        The second one, of the same kind, linked to the first.
    water : float, optional
        Attenuation of water, 1/mm, so that values are also shown in HU.
    titles : sequence of str, optional
        Names of the two.
    port : int, optional
        Port on loopback. The default is the first free one from 8765 on.
    open_browser : bool, optional
        Whether to open the browser.

    Returns
    -------
    ViewWidget or None
        In a notebook, the widget: `position` is the crosshair's, `value` the value there, `window` the values drawn black and
        white. None after a served page.

    Raises
    ------
    DataError
        If a volume stands next to a scan, or `water` is not valid.
    ExtraError
        In a notebook, if the packages of palpate[notebook] are not installed.
    PortError
        If the port is taken.

    Examples
    --------
    >>> pp.view(volume)  # doctest: +SKIP
    >>> try:
    ...     pp.view(volume, scan, open_browser=False)
    ... except pp.errors.DataError:
    ...     print("two kinds")
    two kinds
    """
    images = [shown] if other is None else [shown, other]
    if in_notebook() and port is None and open_browser:
        return view_widget(images, titles, water)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        payloads = image_payloads(images, titles, water)
        with shutdown_requests() as ended, serving_images(payloads, listener) as address:
            announce(address, "look at it", [])
            show(address, ended, open_browser)
    print("\npalpate: closed")
    return None


def view_widget(images: Sequence[Volume | Scan], titles: Sequence[str], water: float | None) -> "ViewWidget":
    """The widget. Raises `ExtraError`, `DataError`, `FileError`."""
    require_extra("pp.view(volume, port=8765)")
    from palpate.display.view_widget import ViewWidget  # its base class is in the extra

    return ViewWidget(images, titles, water)
