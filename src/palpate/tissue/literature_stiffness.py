"""Stiffness of tissues from the literature, with sources."""

from dataclasses import dataclass

_SAMANI = (
    "A. Samani, J. Zubovits, D. Plewes, Elastic moduli of normal and pathological human breast tissues, "
    "Phys. Med. Biol. 52 (2007) 1565, doi 10.1088/0031-9155/52/6/002; 169 fresh samples ex vivo, small strain"
)
_LIVER = "table 1 of Phys. Med. Biol. 64 (2019) 225001, doi 10.1088/1361-6560/ab5010, shear modulus times 3"
_KIDNEY = (
    "O. Rouvière et al., J. Magn. Reson. Imaging 34 (2011) 880, magnetic resonance elastography at 45 Hz of ten "
    "healthy volunteers, shear modulus 4.9 ± 0.5 kPa times 3; softer when slow, as tissue is"
)


@dataclass(frozen=True)
class Material:
    """young: Young's modulus, kPa. spread: one standard deviation as published, kPa. source: where from, and how."""

    young: float
    spread: float
    source: str


MATERIALS = {
    "breast fat": Material(3.25, 0.91, _SAMANI),
    "breast fibroglandular": Material(3.24, 0.61, _SAMANI),
    "breast fibroadenoma": Material(6.41, 2.86, _SAMANI),
    "breast carcinoma, ductal, high grade": Material(42.52, 12.47, _SAMANI),
    "liver": Material(5.4, 1.2, _LIVER),
    "liver carcinoma": Material(70.2, float("nan"), _LIVER),
    "kidney": Material(14.7, 1.5, _KIDNEY),
}
"""By name; all tissue is nearly incompressible (0.49 and more), and 0.45 is the usual compromise with P1 elements."""
