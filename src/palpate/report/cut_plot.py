"""Draws the cuts of a tissue."""

from palpate.arrays import ArrayLike, float64
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.report.figures import draw_frame, draw_solid
from palpate.report.plot_axes import INK
from palpate.tissue.tissue import Tissue
from palpate.volumes.notebook_figure import Picture

EYES = {"from +x, −y": (20, -45), "from −x, +y": (20, 135)}  # elevation and azimuth, degrees
SKIN, LIP = "#b8c4cf", "#d62728"


def plot_cut(tissue: Tissue, displacement: ArrayLike | None = None) -> Picture:
    """Draw a cut tissue from two sides: its surface, through which the faces of the cuts are seen in red.

    Parameters
    ----------
    tissue : Tissue
        What `cut` made.
    displacement : array_like, (N, 3), optional
        Of its nodes, mm, such as `gape` gives; the tissue is drawn so moved.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If the tissue has not been cut, or the displacement has another shape.

    Examples
    --------
    >>> opened = pp.cut(tissue, pp.incision(tissue, [top - (8, 0, 0), top + (8, 0, 0)], depth=10))
    >>> pp.plot_cut(opened).savefig("cut.png")
    """
    mesh = tissue.mesh
    if not isinstance(mesh, CutMesh):
        raise DataError("tissue: has not been cut; make a cut with pp.cut")
    skin, places = mesh.skin, mesh.places
    if displacement is not None:
        places = places + skin.carried(mesh.tets, float64("displacement", displacement, (len(mesh.nodes), 3)))
    figure = Picture(figsize=(10, 5.2), layout="constrained")
    for k, (name, eye) in enumerate(EYES.items()):
        axes = figure.add_subplot(1, 2, k + 1, projection="3d")
        draw_solid(axes, places, skin.triangles[~skin.lip], SKIN, alpha=0.25)
        if skin.lip.any():
            draw_solid(axes, places, skin.triangles[skin.lip], LIP)
        draw_frame(axes, places, eye)
        axes.set_title(name, fontsize=9, color=INK)
    figure.suptitle(mesh.text(), fontsize=9, color=INK)
    return figure
