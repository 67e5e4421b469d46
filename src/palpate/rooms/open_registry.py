"""Opens the registry at an address, by the library of its kind."""

from urllib.parse import urlsplit

from palpate.errors import DataError
from palpate.rooms.registry import Registry, without_password


def open_registry(address: str) -> Registry:
    """The registry at an address.

    Raises `DataError` if no registry goes by such an address, and `ExtraError` if its library is not installed.
    """
    # Each needs its own library, which few users have.
    scheme = urlsplit(address).scheme
    if scheme in ("redis", "rediss", "unix"):
        from palpate.rooms.redis_registry import RedisRegistry

        return RedisRegistry(address)
    if scheme in ("nats", "tls"):
        from palpate.rooms.nats_registry import NatsRegistry

        return NatsRegistry(address)
    raise DataError(f"registry {without_password(address)}: expected redis://HOST:6379 or nats://HOST:4222")
