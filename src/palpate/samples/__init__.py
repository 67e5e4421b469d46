"""Small open data sets that ship with the package, each with its licence beside it."""

from pathlib import Path

from palpate.errors import FileError


def sample(name: str) -> Path:
    """Folder of a sample: "breast" (FDA photon counts), "head" (portal projections), "abdomen" (CT and labels)."""
    folder = Path(__file__).parent / name
    if not folder.is_dir():
        there = sorted(p.name for p in Path(__file__).parent.iterdir() if p.is_dir() and p.name[0] != "_")
        raise FileError(f"there is no sample {name!r}; samples: {', '.join(there)}")
    return folder
