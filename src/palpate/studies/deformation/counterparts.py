"""Which figure and table of the chapter has its counterpart where in the report."""

from collections.abc import Sequence

from palpate.report.html_report import Section
from palpate.studies.counterparts import list_counterparts

# Number where it is known, what it shows, the section that shows it, and how: pictures by number, or the table.
COUNTERPARTS = (
    ("table 3.1", "the deformed-node index table, row by row", "The deformed-node index table", "table"),
    ("table 3.2", "the best RSC0 by Poisson's ratio", "Error against RSC0", "table"),
    ("table", "deformation times of the kidney, by resolution", "Kidney at several resolutions", "table"),
    ("figure", "a node's neighbours in rows about the contact point", "How far a push reaches", "picture 1"),
    ("figure 3.6", "a small displacement moves few nodes, a larger one more", "How far a push reaches", "picture 1"),
    ("figure", "the cube pushed 5 mm, springs and finite elements", "The cube at 5, 10 and 15 mm", "picture 1"),
    ("figure", "the cube pushed 10 mm", "The cube at 5, 10 and 15 mm", "picture 2"),
    ("figure", "the cube pushed 15 mm", "The cube at 5, 10 and 15 mm", "picture 3"),
    ("figure", "nodal displacement over the distance to the contact", "The cube at 5, 10 and 15 mm", "picture 4"),
    ("figure", "absolute difference of nodal displacement", "The cube at 5, 10 and 15 mm", "picture 5"),
    ("figure", "normalised difference of nodal displacement", "The cube at 5, 10 and 15 mm", "picture 6"),
    ("figure", "uniform RSC, low and high, against adaptive RSC", "Uniform and adaptive RSC", "picture 1"),
    ("figure 3.11", "the two laws, RSC0 -0.10, -0.14, -0.18: the laws", "Every reading of the set-up", "picture 1"),
    ("figure 3.11", "the two laws, RSC0 -0.10, -0.14, -0.18: differences", "Uniform and adaptive RSC", "picture 2"),
    ("figure", "error over RSC0 for each Poisson's ratio", "Error against RSC0", "picture 1"),
    ("figure", "a finer mesh, an irregular mesh", "A finer mesh, an irregular mesh", "picture 1"),
    ("figure", "convergence on 5, 11 and 21 nodes a side", "Convergence and stability", "picture 1"),
    ("figure", "stability on 5, 11 and 21 nodes a side", "Convergence and stability", "table"),
    ("figure", "a kidney pushed and pulled, wireframe and shaded", "The kidney pushed and pulled", "picture 1"),
    ("figure", "times of the kidney by resolution", "Kidney at several resolutions", "picture 1"),
)


def counterparts(sections: Sequence[Section]) -> Section:
    """The list, checked against the sections."""
    text = [
        "Figures 3.5 to 3.16 and tables 3.1 and 3.2 by what their captions show. The text of the chapter is not at hand: "
        "numbers stand where they are known; table 3.2 may be that of deformation times. Frames a second by resolution and "
        "way of drawing are measured by palpate study realtime.",
    ]
    return list_counterparts(sections, COUNTERPARTS, text)
