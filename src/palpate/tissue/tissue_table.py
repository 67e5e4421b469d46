"""The table of named tissues. `python docs/tissues.py` writes docs/tissues.md from it.

Verified: the number was read in the source, in its abstract, or in a table that quotes it. What is left out is unknown.
"""

from palpate.tissue.tissue_properties import Measured, TissueProperties

_LIVER = {
    "method": "compiled from the literature, said to be quasi-static",
    "source": "table 1 of Phys. Med. Biol. 64 (2019) 225001",
    "doi": "10.1088/1361-6560/ab5010",
}
_HATT = {
    "method": "MR elastography at 50 Hz under four static compressions, ten women's buttocks, human, in vivo",
    "source": "A. Hatt, R. Lloyd, B. Bolsterlee, L. Bilston, Journal of the Mechanical Behavior of Biomedical Materials "
    "(2023) 105924",
    "doi": "10.1016/j.jmbbm.2023.105924",
}
_AORTA = {
    "method": "nanoindentation, quasi-linear viscoelastic, thoracic aorta, pig, ex vivo; mean of the two halves of the wall",
    "source": "A. Hemmasizadeh, M. Autieri, K. Darvish, Journal of the Mechanical Behavior of Biomedical Materials 15 "
    "(2012) 199",
    "doi": "10.1016/j.jmbbm.2012.06.008",
}
_BOSBOOM = {
    "method": "indentation across the fibres, viscoelastic Ogden model, four tibialis anterior muscles, rat, in vivo",
    "source": "E. Bosboom et al., J. Biomech. 34 (2001) 1365",
}
_MOUSE_SKIN = {
    "method": "unconfined compression, quasi-linear viscoelastic, 139 samples, mouse, ex vivo",
    "source": "Y. Wang et al., PLoS ONE 10 (2015) e0120897",
    "doi": "10.1371/journal.pone.0120897",
}
_CREEP = {
    "method": "creep under 2 to 5 N for up to 200 s, human breast, in vivo; retardation times of a Voigt model",
    "source": "Ultrasonic measurements of breast viscoelasticity (2007), PMC2707145",
}
_KAYE_LABY = {
    "method": "compiled; human",
    "source": "Kaye and Laby, Tables of Physical and Chemical Constants, section 2.4.6, as listed by medicalalgorithms.com",
}
_VOXELS = {
    "method": "compiled; densities given to a voxel phantom, human",
    "source": "table 1 of Rep. Pract. Oncol. Radiother. 19 (2014) 392",
    "doi": "10.1016/j.rpor.2014.03.004",
}
_PHANTOM = {
    "method": "compiled, after ICRU Report 46; reference man",
    "source": "table 2 of Health Phys. 102 (2012), no. 3",
    "doi": "10.1097/HP.0b013e318235163f",
}
_TOUGHNESS = {
    "source": "table 2 of Recent Advances in Soft Biological Tissue Manipulating Technologies, Chin. J. Mech. Eng. (2022)",
    "doi": "10.1186/s10033-022-00767-4",
}


def _measured(
    unit: str,
    value: float | None,
    spread: float | None = None,
    low: float | None = None,
    high: float | None = None,
    /,
    *,
    method: str,
    source: str,
    doi: str = "",
    printed: str = "",
) -> Measured:
    """A quantity that was looked up."""
    return Measured(value, unit, spread, low, high, printed, method, source, doi, verified=True)


def _samani(young: float, spread: float, which: str = "") -> Measured:
    return Measured(
        young,
        "kPa",
        spread,
        method="small strain, human, ex vivo, 169 fresh samples" + which,
        source="A. Samani, J. Zubovits, D. Plewes, Elastic moduli of normal and pathological human breast tissues, "
        "Phys. Med. Biol. 52 (2007) 1565",
        doi="10.1088/0031-9155/52/6/002",
        verified=False,  # its abstract agrees, but prints only the ratios
    )


def _from_shear(
    shear: float,
    spread: float | None = None,
    low: float | None = None,
    high: float | None = None,
    /,
    *,
    method: str,
    source: str,
    doi: str = "",
) -> Measured:
    """E = 2 (1 + ν) μ with ν = 0.5, kPa."""
    printed = f"shear modulus {shear:g}{'' if spread is None else f' ± {spread:g}'} kPa, here times 3"
    three = [None if x is None else round(3 * x, 3) for x in (shear, spread, low, high)]
    return _measured("kPa", *three, method=method, source=source, doi=doi, printed=printed)


_ALL = (
    TissueProperties(
        "skin",
        young=_measured(
            "kPa",
            56.3,
            16.4,
            method="suction below 40 mbar and inverse analysis, breast, seven volunteers, human, in vivo",
            source="In vivo measurement of breast tissues stiffness using a light aspiration device",
        ),
        density=_measured("kg/m³", 1100, **_VOXELS),
        relaxed=_measured("", 0.72, 0.13, printed="residual stress ratio 0.28 ± 0.13", **_MOUSE_SKIN),
        relaxation_time=_measured("s", 0.19, 0.10, **_MOUSE_SKIN),
        fracture_energy=_measured(
            "J/m²", 1136, None, 1136, 30400, method="needle; the higher by tearing; pig, ex vivo", **_TOUGHNESS
        ),
    ),
    TissueProperties(
        "fat",
        young=_samani(3.25, 0.91),
        density=_measured("kg/m³", 950, **_VOXELS),
        stiffening=_measured("", 1.18, printed="G = 748.5 Pa × Cyy^-1.18", **_HATT),
        fracture_energy=_measured("J/m²", 4100, method="trouser tear, pig, ex vivo", **_TOUGHNESS),
    ),
    TissueProperties(
        "gland",
        young=_samani(3.24, 0.61),
        density=_measured("kg/m³", 1020, **_KAYE_LABY | {"method": "compiled, whole breast; human"}),
        relaxed=_measured("", 0.5, printed="viscoelastic strain about equal to the elastic strain", **_CREEP),
        relaxation_time=_measured("s", 3.2, 0.8, **_CREEP),
        slow_relaxation_time=_measured("s", 42.0, 28, **_CREEP),
    ),
    TissueProperties(
        "muscle",
        young=_from_shear(1.0, **_HATT),
        density=_measured("kg/m³", 1047, None, 1038, 1056, **_KAYE_LABY),
        relaxed=_measured("", 0.549, 0.056, printed="delta 0.549 ± 0.056", **_BOSBOOM),
        relaxation_time=_measured("s", 6.01, 0.42, **_BOSBOOM),
        stiffening=_measured("", 0.36, printed="G = 956.4 Pa × Cyy^-0.36", **_HATT),
        fracture_energy=_measured(
            "J/m²", None, None, 550, 8000, method="single edge notch, pig, ex vivo", **_TOUGHNESS
        ),
    ),
    TissueProperties(
        "liver",
        young=_from_shear(1.8, 0.4, **_LIVER),
        density=_measured("kg/m³", 1060, **_LIVER),
        fracture_energy=_measured(
            "J/m²",
            164,
            6,
            method="needles of four diameters, three livers, cattle, ex vivo",
            source="C. Gokgol, C. Basdogan, D. Canadinc, Med. Eng. Phys. 34 (2012) 882",
            doi="10.1016/j.medengphy.2011.09.030",
        ),
    ),
    TissueProperties(
        "kidney",
        young=_from_shear(
            4.9,
            0.5,
            method="MR elastography at 45 Hz, ten volunteers, human, in vivo; softer when slow, as tissue is",
            source="O. Rouvière et al., J. Magn. Reson. Imaging 34 (2011) 880",
            doi="10.1002/jmri.22670",
        ),
        density=_measured("kg/m³", 1050, **_KAYE_LABY),
    ),
    TissueProperties(
        "spleen",
        young=_from_shear(
            3.565,
            0.586,
            2.353,
            4.442,
            method="MR elastography at 60 Hz, driver on the right, 16 volunteers, human, in vivo",
            source="L. Mannelli et al., AJR Am. J. Roentgenol. 195 (2010) 387",
            doi="10.2214/AJR.09.3390",
        ),
        density=_measured("kg/m³", 1054, **_KAYE_LABY),
    ),
    TissueProperties(
        "lung",
        young=_measured(
            "kPa",
            1.4,
            0.4,
            1.4,
            6.1,
            method="micro-indentation, 12 animals, ex vivo; the range is that of four methods",
            source="S. Polio et al., PLoS ONE 13 (2018) e0204765",
            doi="10.1371/journal.pone.0204765",
        ),
        poisson=_measured(
            "",
            0.43,
            method="uniaxial load and bulk modulus of inflated lobes, dog, ex vivo",
            source="S. Lai-Fook, T. Wilson, R. Hyatt, J. Rodarte, J. Appl. Physiol. 40 (1976) 508",
            doi="10.1152/jappl.1976.40.4.508",
        ),
        density=_measured("kg/m³", 380, **_PHANTOM | {"method": "calculated, blood included; reference man"}),
    ),
    TissueProperties(
        "vessel",
        young=_measured(
            "kPa", 65.3, printed="outer half 70.27 ± 2.47 kPa, inner half 60.32 ± 1.65 kPa, instantaneous", **_AORTA
        ),
        density=_measured("kg/m³", 1050, **_LIVER | {"method": "compiled from the literature, hepatic artery"}),
        relaxed=_measured("", 0.66, printed="reduced relaxation 0.35 ± 0.01 and 0.33 ± 0.01", **_AORTA),
        fracture_energy=_measured(
            "J/m²",
            290,
            110,
            290,
            1700,
            method="aorta cut with a blade; the higher by tearing; pig, ex vivo",
            **_TOUGHNESS,
        ),
    ),
    TissueProperties(
        "bowel",
        young=_measured(
            "kPa",
            180.07,
            17.01,
            180.07,
            307.25,
            method="biaxial tension, low-modulus region, around the small bowel; along it the higher; pig, ex vivo",
            source="B. Terry, X. Wang, J. Schoen, M. Rentschler, Int. J. Exp. Comput. Biomech. 2 (2014), no. 4",
        ),
        density=_measured(
            "kg/m³", 1030, **_PHANTOM | {"method": "compiled, wall of the gastrointestinal tract; reference man"}
        ),
    ),
    TissueProperties(
        "breast-carcinoma",
        young=_samani(42.52, 12.47, "; ductal, high grade"),
    ),
    TissueProperties("fibroadenoma", young=_samani(6.41, 2.86)),
    TissueProperties("liver-carcinoma", young=_from_shear(23.4, **_LIVER), density=_measured("kg/m³", 1060, **_LIVER)),
)

TISSUES = {tissue.name: tissue for tissue in _ALL}
"""By name."""
