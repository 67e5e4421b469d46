"""A user's own parts: registered by a decorator, or found as entry points of installed packages.

A part has a kind and a name. Its entry point belongs to the group "palpate.<kind>s", such as "palpate.optimizers". For the
commands, `palpate --plugin FILE ...` or the variable PALPATE_PLUGINS loads a file that registers parts.
"""

import importlib.util
import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any, TypeVar

from palpate.errors import DataError, FileError

T = TypeVar("T")
BUILT_IN: Mapping[str, tuple[str, ...]] = {
    "optimizer": ("auto", "momentum", "descent", "subsets"),
    "tissue_model": ("springs", "blocks", "multigrid", "compliance", "neo-hookean", "compliance-P1"),
    "device": ("open-haptics", "force-dimension", "haply"),
    "segmenter": ("threshold",),
    "reader": (
        ".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".zarr", ".tif", ".tiff", ".dcm", ".dicom", ".ima", ".h5",
    ),
}  # fmt: skip
_registered: dict[str, dict[str, Any]] = {kind: {} for kind in BUILT_IN}


def register_optimizer(name: str) -> Callable[[T], T]:
    """Register a class as an optimizer of `reconstruct`.

    Parameters
    ----------
    name : str
        The optimizer's name in `pp.reconstruct(scan, optimizer=name)` and `palpate reconstruct --optimizer name`.

    Returns
    -------
    callable
        A decorator of the class. The class is made once for each resolution level, as `Own(problem, values, state)`:
        `palpate.reconstruction.optimizers.problem` has the types. `problem` holds the projector, the likelihood and the
        prior, and `problem.support`: 0 where f = 0 must hold, or None. `values` is the start, (z, y, x) 1/mm.
        `state` is empty, or what `state()` returned when the run was stopped. `update()` returns the next iterate and
        the objective there. `state()` returns arrays by name: all that `update` needs besides the iterate to go on to
        the bit.

    Raises
    ------
    DataError
        If the name is that of a built-in optimizer.

    Examples
    --------
    >>> @pp.register_optimizer("fixed")
    ... class Fixed:
    ...     def __init__(self, problem, values, state):
    ...         self.problem, self.values = problem, values
    ...     def update(self):
    ...         return self.values, self.problem.objective(self.values)
    ...     def state(self):
    ...         return {}
    """
    return _register("optimizer", name)


def register_tissue_model(name: str) -> Callable[[T], T]:
    """Register a class as a tissue model.

    Parameters
    ----------
    name : str
        The model's name in `pp.model(tissue, name)` and `palpate touch --model name`.

    Returns
    -------
    callable
        A decorator of the class, which derives from `palpate.tissue.models.python_model.PythonModel`.

    Raises
    ------
    DataError
        If the name is that of a built-in model.

    Examples
    --------
    >>> @pp.register_tissue_model("own")
    ... class Own:
    ...     pass
    """
    return _register("tissue_model", name)


def register_device(name: str) -> Callable[[T], T]:
    """Register a class as a force-feedback device.

    Parameters
    ----------
    name : str
        The device's name in `palpate touch --device name`.

    Returns
    -------
    callable
        A decorator of the class, made as `Own(where)`: `where` is what follows a colon in the name, else None.
        `palpate.haptics.python_device.Device` lists what it has: `rate`, `force`, `stiffness`, `lowest`, `highest`,
        `read()` and `write(force)`.

    Raises
    ------
    DataError
        If the name is that of a built-in device.

    Examples
    --------
    >>> @pp.register_device("still")
    ... class Still:
    ...     rate, force, stiffness = 500, 3.0, 0.5
    ...     lowest, highest = (-100, -100, -100), (100, 100, 100)
    ...     def __init__(self, where):
    ...         pass
    ...     def read(self):
    ...         return (0, 0, 50), 0
    ...     def write(self, force):
    ...         pass
    """
    return _register("device", name)


def register_segmenter(name: str) -> Callable[[T], T]:
    """Register a function as a method of `segment`.

    Parameters
    ----------
    name : str
        The method's name in `pp.segment(volume, method=name)` and `palpate segment --method name`.

    Returns
    -------
    callable
        A decorator of the function. It takes a `Volume` and returns a mask, bool (z, y, x).

    Raises
    ------
    DataError
        If the name is that of a built-in method.

    Examples
    --------
    >>> @pp.register_segmenter("above-mean")
    ... def above_mean(volume):
    ...     return volume.values > volume.values.mean()
    """
    return _register("segmenter", name)


def register_reader(suffix: str) -> Callable[[T], T]:
    """Register a function as the reader of files with this suffix.

    Parameters
    ----------
    suffix : str
        The end of the file's name, with its dot. `read_volume`, `read_labels`, `read_scan` and all commands use it.

    Returns
    -------
    callable
        A decorator of the function. It takes a `pathlib.Path` and returns a `Volume`, `Labels` or `Scan`.

    Raises
    ------
    DataError
        If palpate reads this suffix itself, or it has no dot.

    Examples
    --------
    >>> @pp.register_reader(".bytes")
    ... def read_bytes(path):
    ...     values = np.fromfile(path, np.uint8).reshape(1, 1, -1)
    ...     return pp.Volume(values, pp.Grid(values.shape, (1, 1, 1), (0, 0, 0)))
    """
    if not suffix.startswith("."):
        raise DataError(f"reader: {suffix!r}: a suffix begins with a dot")
    return _register("reader", suffix.lower())


def _register(kind: str, name: str) -> Callable[[T], T]:
    if name in BUILT_IN[kind]:
        raise DataError(f"{kind}: {name!r} is built in; choose another name")

    def add(part: T) -> T:
        _registered[kind][name] = part
        return part

    return add


@cache  # the search takes milliseconds, as long as a small model takes to build
def _entry_points(kind: str) -> EntryPoints:
    return entry_points(group=f"palpate.{kind}s")


def names(kind: str) -> tuple[str, ...]:
    """Names of all registered parts of a kind, the built-in ones first."""
    own = {*_registered[kind], *_entry_points(kind).names}
    return (*BUILT_IN[kind], *sorted(own - {*BUILT_IN[kind]}))


def part(kind: str, name: str) -> Any:
    """The registered part; None if there is none of this name. An entry point is loaded when its part is first used."""
    if name not in _registered[kind] and name not in BUILT_IN[kind]:
        for point in _entry_points(kind).select(name=name):
            _registered[kind][name] = point.load()
    return _registered[kind].get(name)


def read_by_plugin(path: Path, wanted: type[T]) -> T | None:
    """What a registered reader makes of the file; None if its suffix has no reader. Raises `FileError`."""
    suffix = next((s for s in names("reader") if path.name.lower().endswith(s)), "")
    reader = part("reader", suffix)
    if reader is None:
        return None
    if not path.exists():
        raise FileError(f"{path}: no such file; check the name (looked from {Path.cwd()})")
    made = reader(path)
    if not isinstance(made, wanted):
        raise FileError(f"{path}: the reader of {suffix} returns {type(made).__name__}, expected {wanted.__name__}")
    return made


def load(path: Path) -> None:
    """Runs a Python file that registers parts. Raises `FileError`."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise FileError(f"{path}: no such Python file; give --plugin a file that registers parts")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)


def include() -> str:
    """Return the folder of palpate's C++ headers, for a tissue model in C++.

    Returns
    -------
    str
        The folder to give to the compiler. The model derives from `TissueModel` in `tissue/tissue_model.h`.

    Examples
    --------
    >>> (Path(pp.include()) / "tissue" / "tissue_model.h").exists()
    True
    """
    installed = Path(__file__).parent / "headers"
    return str(installed if installed.is_dir() else Path(__file__).parents[2] / "cpp")  # a checkout has them in cpp/
