"""Writes docs/tissues.md from palpate's table of tissues: `python docs/tissues.py`. A test compares the two."""

from pathlib import Path

from palpate.tissue.tissue_properties import QUANTITIES, TissueProperties
from palpate.tissue.tissue_table import TISSUES

PAGE = Path(__file__).parent / "tissues.md"
HOW_TO = """# Named tissues and stiffness maps

Made by `python docs/tissues.py` from `src/palpate/tissue/tissue_table.py`.

## By name

```sh
palpate fit liver.vtu --tissue liver --region-tissue lump=liver-carcinoma -o tissue.vtu
palpate fit --list-tissues
```

```python
tissue = pp.fit(mesh, tissue={"organ": "liver", "lump": "liver-carcinoma"}, fixed=fixed)
pp.tissue_properties("liver").fracture_energy
```

Numbers that you give win over the table: `--young`, `--poisson`, `--region-young`, `--region-poisson`. One exception is
`--region-tissue`, which wins over the general `--young` in its region. `palpate fit` prints the source of each number
that it takes. The tissue file keeps the names of the tissues, and the standard deviation that the source prints of Young's
modulus: the page tells what [that makes of the force](truth.md#the-spread-of-the-stiffness).

What the table does not know is *unknown*, and you must give it where it is needed. Poisson's ratio is the exception:
where it is unknown, `fit` takes its default, since all of these tissues but the lung are nearly incompressible.

**Not verified** means that the number was not seen in its source when the table was made. Look it up before you rely on
it. The others were read in the source, in its abstract, or in a table that quotes it. No DOI means that none was seen.

Numbers of one tissue come from several papers, species and rates. Young's modulus from elastography is that of fast, small
vibrations; tissue is softer under a slow press. `fit` uses Young's modulus and Poisson's ratio only; give a relaxation
yourself, such as `--relaxation 0.55@6` for muscle. The relaxed fraction is the share of the stress that is gone in the end
when a strain is held. The stiffening exponent n says that the shear modulus grows as C⁻ⁿ when C, which is 1 at rest, falls
in compression. It is not the exponent b of `--stiffening`, which belongs to [another law](theory/simulation.md#stiffening):
that one must come from you.

## From a stiffness map

```sh
palpate fit liver.vtu --stiffness elastogram.nii.gz --quantity shear -o tissue.vtu
```

```python
young = pp.stiffness_from_map(mesh, pp.read_volume("elastogram.nii.gz"), quantity="shear", poisson=0.45)
tissue = pp.fit(mesh, young, poisson=0.45, fixed=fixed)
```

The map is in kPa and in the space of the scan that the mesh comes from. Each tetrahedron has the mean of the map over
itself. `--quantity` must say what the map holds: `shear`, which MR elastography gives, or `young`. The shear modulus μ
becomes E = 2 (1 + ν) μ. Voxels of zero hold no measurement. NaN, negative values, a map that is not in kPa and a map that
leaves part of the mesh uncovered are refused.
"""


def section(known: TissueProperties) -> str:
    """The table of one tissue."""
    lines = [
        f"### {known.name}",
        "",
        "| quantity | value | method | source | DOI | verified |",
        "|---|---|---|---|---|---|",
    ]
    for quantity, (words, _) in QUANTITIES.items():
        found = known.measured(quantity)
        if found is None:
            cells = [words, "unknown", "", "", "", ""]
        else:
            method = f"{found.method}; printed as {found.printed}" if found.printed else found.method
            doi = f"[{found.doi}](https://doi.org/{found.doi})" if found.doi else ""
            cells = [words, found.text, method, found.source, doi, "yes" if found.verified else "**not verified**"]
        lines.append(f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |"))
    return "\n".join(lines)


def page() -> str:
    """All of docs/tissues.md."""
    return "\n".join([HOW_TO, "## The table", "", "\n\n".join(section(known) for known in TISSUES.values()), ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
