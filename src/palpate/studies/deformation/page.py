"""The report's sections, in the order of the dissertation's chapter and then beyond."""

from palpate.studies.deformation import beyond, chapter, claims
from palpate.studies.deformation.told import Told
from palpate.studies.report import Section


def sections(told: Told) -> list[Section]:
    """All of them."""
    parts = [
        chapter.set_up,
        chapter.cube,
        chapter.laws,
        chapter.optimum,
        chapter.meshes,
        chapter.sweeps,
        chapter.kidneys,
    ]
    parts += [beyond.ladder, beyond.needed, beyond.fit, beyond.ripple, beyond.loops, beyond.strain, beyond.truth_cube]
    return [*conclusions(told), *(part(told) for part in parts), files(told)]


def conclusions(told: Told) -> list[Section]:
    """Claims and promises with their verdicts."""
    text = [
        "Every number here is computed in this run; the tables beside this report hold what it is made from. Springs are "
        "judged by quadratic finite elements (P2, scikit-fem's assembly, a direct solution), which share nothing with them "
        "but the mesh. Times are processor time of one core.",
        "Worst is the greatest difference of displacement over all nodes, as a length; errors against finite elements are "
        "not the certified bound of an answer, which speaks of the model's own equations.",
    ]
    return [
        Section("The dissertation's claims", text, claims.claims(told.tables, told.setting)),
        Section(
            "What palpate promises beyond",
            ["Each path and radius; what fails is said."],
            claims.own_claims(told.tables),
        ),
    ]


def files(told: Told) -> Section:
    """What lies in the folder."""
    text = [
        "tables/: every number (CSV). figures/: the pictures (PNG). runs/: each experiment (JSON, NPZ), "
        "from which --resume goes on."
    ]
    return Section("Files", text)
