"""Joins a room with a haptic device."""

import asyncio
import webbrowser
from pathlib import Path

from palpate.haptics.discovery import open_device
from palpate.rooms.room_site import RoomSite
from palpate.rooms.room_way import room_way
from palpate.server.loopback_server import has_display, shutdown_requests

ENERGY = 0.8  # mJ that a contact may give the hand before its force fades; at twice that there is none


def join(
    address: str, device: str = "haply", *, certificate: str | Path | None = None, open_browser: bool = False
) -> None:
    """Join a room with a haptic device at this machine, and stay until Ctrl-C.

    The organ is fetched and computed here, so that the hand is answered at once however far the room is. No force comes
    over the network. When the room is silent or lost, the force is withdrawn, and it comes back with the room.

    Parameters
    ----------
    address : str
        The invitation, as `palpate serve` and `palpate invite` print it.
    device : str, optional
        Name of the device: "haply", "open-haptics", "force-dimension", or one of `register_device`; after a colon where it
        is, as in "haply:localhost:10001".
    certificate : str or Path, optional
        File of a certificate to trust (PEM), if the server's is signed by nobody known.
    open_browser : bool, optional
        Whether to open the room's page here too, to see the organ.

    Raises
    ------
    DataError
        If the invitation is not let in or is a viewer's, the room is none to touch from another site, its certificate is
        not trusted, or it is served by another version.
    PortError
        If no server answers.
    DeviceError
        If the device does not answer.
    FileError
        If the file of the certificate cannot be read.

    Examples
    --------
    >>> pp.join("https://simulator.example.org/?token=...", "haply")  # doctest: +SKIP
    >>> try:
    ...     pp.join("https://simulator.example.org/")
    ... except pp.errors.DataError:
    ...     print("no invitation")
    no invitation
    """
    way = room_way(address, certificate)
    site = RoomSite(way, lambda text: print(f"palpate: {text}", flush=True))
    with shutdown_requests() as ended:
        asyncio.run(site.fetch())
        assert site.session is not None
        haptic = open_device(device, site.session.mesh, energy=ENERGY)
        try:
            site.start(haptic)
            with haptic:
                if open_browser and has_display():
                    webbrowser.open(address)
                print("palpate: Ctrl-C leaves the room. Research software, not a medical device.", flush=True)
                asyncio.run(site.stay(lambda: not ended.empty()))
        finally:
            haptic.stop()
            site.stop()
    print("\npalpate: left")
