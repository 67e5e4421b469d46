"""Small open data sets that ship with the package, each with its licence beside it."""

from pathlib import Path

from palpate.errors import FileError

# The kidney of the sample "abdomen", as the demo and the study of deformation take it.
KIDNEY_LABEL = "kidney_left"
KIDNEY_POISSON = 0.45  # Poisson's ratio
KIDNEY_BED = 0.25  # share of its depth, from the back, that lies in fat and muscle and is held still


def sample(name: str) -> Path:
    """Folder of a sample: "breast" (FDA photon counts), "head" (portal projections), "abdomen" (CT and labels)."""
    folder = Path(__file__).parent / name
    if not folder.is_dir():
        there = sorted(p.name for p in Path(__file__).parent.iterdir() if p.is_dir() and p.name[0] != "_")
        raise FileError(f"there is no sample {name!r}; samples: {', '.join(there)}")
    return folder
