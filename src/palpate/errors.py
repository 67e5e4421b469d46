"""What can go wrong, each error derived from the matching built-in, so that `except ValueError` works."""


class PalpateError(Exception):
    """Anything palpate refuses. The message names the thing, the value found, and the way out."""


class GeometryError(PalpateError, ValueError):
    """A source, panel or grid that cannot be, or that do not meet."""


class DataError(PalpateError, ValueError):
    """Counts, volumes or labels of the wrong shape, type or value."""


class MeshError(PalpateError, ValueError):
    """A mesh that is not a valid solid."""


class MaterialError(PalpateError, ValueError):
    """Elastic constants or supports that no tissue can have."""


class FileError(PalpateError, OSError):
    """A file that is missing, truncated, of another kind, or cannot be written."""


class PortError(PalpateError, OSError):
    """A network port that is taken."""


class ClusterError(PalpateError, OSError):
    """A scheduler, or a worker of it, that does not answer, is gone, or does not see the files."""


class ExtraError(PalpateError, ImportError):
    """A package that palpate needs for this alone, and that is not installed. The message names the extra that has it."""


class DeviceError(PalpateError, OSError):
    """A haptic device that is not there, not ready or not well. `fault` is its short name."""

    def __init__(self, message: str, fault: str) -> None:
        super().__init__(message)
        self.fault = fault
