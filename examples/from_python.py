"""From photon counts to the force under a fingertip, all from Python: python examples/from_python.py [--quick] [--touch]

--quick: voxels and elements so coarse that it ends in seconds; the picture is poor, the way is the same.
--touch: end with the breast in the browser.
"""

import sys

import palpate as pp


def main(quick: bool = False) -> tuple[pp.Tissue, float]:
    """Gives the tissue, and the force (N) of a press by 2 mm on its highest point."""
    scan = pp.import_scan("breast")  # a sample; or your stack and its geometry file
    volume = pp.reconstruct(scan, thickness=51.2, spacing=3.0 if quick else None, levels=1 if quick else None)
    labels = pp.segment(volume, keep="largest", fill_holes=True, name="breast")
    mesh = pp.tetrahedralize(labels, "breast", edge=14.0 if quick else 6.0, closed_at_border=True)
    tissue = pp.fit(mesh, young=3.2, poisson=0.45, fixed=pp.resting_on(mesh, (0, 0, -1)))
    top = mesh.nodes[mesh.nodes[:, 2].argmax()]
    answer = pp.model(tissue, "blocks").push(points=top, displacements=(0, 0, -2), radii=12)
    return tissue, float(answer.force[2])  # N, of the tissue on the tool


if __name__ == "__main__":
    tissue, force = main(quick="--quick" in sys.argv)
    print(f"{len(tissue.mesh.tets)} tetrahedra; pressed in by 2 mm, the breast pushes back with {force:.3f} N")
    if "--touch" in sys.argv:
        pp.touch(tissue)
