"""Quality of a mesh: shape of its tetrahedra, topology of its surface, distance from the labels."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, Bool, Float64, Int32
from palpate.errors import DataError
from palpate.meshes.element_quality import dihedrals, radius_ratios
from palpate.meshes.stuffing.level_set import Level, box_of, inner_distance
from palpate.meshes.tet_mesh import TetMesh, boundary_faces, shared_faces
from palpate.meshes.triangle_surface import connected_groups, distance_to_surface, non_manifold_parts, shells_and_genus
from palpate.volumes.volume import Labels


@dataclass(frozen=True)
class RegionQuality:
    """One region: volumes in mm³, distances between its skin and that of its smoothed label in mm (None: no labels);
    distance_max is the Hausdorff distance, the larger of both ways.

    parts: pieces joined by faces; skins: closed surfaces around it (one for itself, one for each hollow or inclusion);
    handles: 0 for ball-like; pinched: nodes and edges at which its skin is not a 2-manifold.
    """

    value: int
    name: str
    tets: int
    volume: float
    parts: int
    skins: int
    handles: int
    pinched: int
    label_volume: float | None = None
    distance_mean: float | None = None
    distance_95: float | None = None
    distance_max: float | None = None

    @property
    def volume_error(self) -> float | None:
        """Part by which the mesh's volume exceeds the label's."""
        return None if self.label_volume is None else self.volume / self.label_volume - 1


@dataclass(frozen=True)
class MeshQuality:
    """A mesh in figures: angles in degrees, lengths in mm; `print` it for a page that reads well."""

    nodes: int
    tets: int
    triangles: int
    edge_min: float
    edge_mean: float
    edge_max: float
    dihedral_min: float
    dihedral_median: float
    dihedral_max: float
    radius_ratio_min: float
    radius_ratio_median: float
    pinched: int
    regions: tuple[RegionQuality, ...]

    @property
    def manifold(self) -> bool:
        """Whether the outer skin is a closed 2-manifold."""
        return self.pinched == 0

    def __str__(self) -> str:
        skin = "closed, 2-manifold" if self.manifold else f"NOT a 2-manifold at {self.pinched} nodes or edges"
        lines = [
            f"{self.nodes} nodes, {self.tets} tets, {self.triangles} surface triangles; skin {skin}",
            f"edges {self.edge_min:.2f} to {self.edge_max:.2f} mm, mean {self.edge_mean:.2f} mm",
            f"dihedral angles {self.dihedral_min:.1f}° to {self.dihedral_max:.1f}°, "
            f"median of the smallest of each tet {self.dihedral_median:.1f}°",
            f"radius ratios {self.radius_ratio_min:.2f} at worst, median {self.radius_ratio_median:.2f} (1 is best)",
        ]
        for r in self.regions:
            form = f"{r.parts} part{'s' * (r.parts > 1)}, {r.skins} skin{'s' * (r.skins > 1)}, {r.handles} handles"
            lines.append(f"region {r.value} ({r.name}): {r.tets} tets, {r.volume / 1000:.2f} ml, {form}")
            if r.volume_error is not None:
                lines.append(
                    f"    against the label: volume {r.volume_error:+.2%}; surface {r.distance_mean:.2f} mm away on "
                    f"average, {r.distance_95:.2f} mm at 95 %, {r.distance_max:.2f} mm at most (Hausdorff), "
                    f"{(r.distance_max or 0) / self.edge_mean:.2f} mean edges"
                )
        return "\n".join(lines)


def mesh_quality(mesh: TetMesh, labels: Labels | None = None) -> MeshQuality:
    """Return angles, lengths and topology of a mesh, and its distance from the labels.

    Parameters
    ----------
    mesh : TetMesh
        The mesh.
    labels : Labels, optional
        Compare each region with the label of its number, as it was meshed: with the voids that the mesh fills, without
        the parts that it leaves out. Distances are between the surface of the region and that of the label smoothed by 0.7
        voxels at equal volume, both ways.

    Returns
    -------
    MeshQuality
        Angles in degrees and lengths in mm; print it.

    Raises
    ------
    DataError
        If a region has no label.

    Examples
    --------
    >>> pp.mesh_quality(mesh).dihedral_min > 5
    True
    """
    filled = None if labels is None else _as_meshed(mesh, labels)
    corners = mesh.nodes[mesh.tets]
    pairs = [(i, j) for i in range(4) for j in range(i)]
    edges = np.stack([np.linalg.norm(corners[:, i] - corners[:, j], axis=1) for i, j in pairs])
    angles = dihedrals(mesh.nodes, mesh.tets)
    ratios = radius_ratios(mesh.nodes, mesh.tets)
    return MeshQuality(
        nodes=len(mesh.nodes),
        tets=len(mesh.tets),
        triangles=len(mesh.surface),
        edge_min=float(edges.min()),
        edge_mean=float(edges.mean()),
        edge_max=float(edges.max()),
        dihedral_min=float(angles.min()),
        dihedral_median=float(np.median(angles.min(axis=1))),
        dihedral_max=float(angles.max()),
        radius_ratio_min=float(ratios.min()),
        radius_ratio_median=float(np.median(ratios)),
        pinched=sum(len(found) for found in non_manifold_parts(mesh.surface)),
        regions=tuple(_region(mesh, int(value), filled) for value in np.unique(mesh.region)),
    )


def _region(mesh: TetMesh, value: int, labels: Labels | None) -> RegionQuality:
    tets = mesh.tets[mesh.region == value]
    skin = boundary_faces(tets)
    skins, handles = shells_and_genus(skin)
    volume = float(mesh.volumes[mesh.region == value].sum())
    pinched = sum(len(found) for found in non_manifold_parts(skin))
    name = mesh.names.get(value, str(value))
    plain = RegionQuality(
        value, name, len(tets), volume, connected_groups(len(tets), shared_faces(tets)[0])[0], skins, handles, pinched
    )
    if labels is None:
        return plain
    mask = labels.values == value
    away = _distances(mesh.nodes, skin, mask, labels)
    return replace(
        plain,
        label_volume=float(np.count_nonzero(mask)) * labels.grid.voxel_volume,
        distance_mean=float(away.mean()),
        distance_95=float(np.quantile(away, 0.95)),
        distance_max=float(away.max()),
    )


def _as_meshed(mesh: TetMesh, labels: Labels) -> Labels:
    """The labels of the mesh's regions, with the voids that the mesh fills and without the parts that it leaves out.

    A void or a part is judged by its deepest voxel, which rounding and smoothing at its border do not reach.
    """
    regions = np.unique(mesh.region)
    there = [int(v) for v in np.unique(labels.values) if v]
    for value in np.setdiff1d(regions, there):
        raise DataError(f"region {value} of the mesh is not among the labels {there}; give the labels it was made from")
    values = np.where(np.isin(labels.values, regions), labels.values, 0)
    box = box_of(values != 0)
    cropped, first = values[box], np.array([side.start for side in box])

    def components(mask: Bool) -> tuple[AnyArray, Int32]:
        """The component of each voxel, and the region of the mesh around the deepest voxel of each component."""
        number, count = ndimage.label(mask)
        deep = inner_distance(mask, labels.grid.spacing)
        places = ndimage.maximum_position(deep, number, range(1, count + 1))
        return number, np.array([0, *(_region_at(mesh, labels.grid.points(first + p)[0]) for p in places)], np.int32)

    void, region = components(ndimage.binary_fill_holes(cropped != 0) & (cropped == 0))
    cropped = np.where(cropped == 0, region[void], cropped)
    part, region = components(cropped != 0)
    kept = np.where(region[part] != 0, cropped, 0)
    values[box] = kept if np.isin(regions, kept).all() else cropped
    return Labels(values, labels.grid)


def _region_at(mesh: TetMesh, point: Float64) -> int:
    """Region of the tet that holds the point (3,) mm; 0 outside the mesh."""
    corners = mesh.nodes[mesh.tets]
    near = np.flatnonzero(((corners.min(axis=1) <= point) & (point <= corners.max(axis=1))).all(axis=1))
    x = corners[near]
    share = np.linalg.solve((x[:, 1:] - x[:, :1]).transpose(0, 2, 1), (point - x[:, 0])[..., None])[..., 0]
    inside = (share > -1e-9).all(axis=1) & (share.sum(axis=1) < 1 + 1e-9)
    return int(mesh.region[near[np.argmax(inside)]]) if inside.any() else 0


def _distances(nodes: Float64, skin: Int32, mask: Bool, labels: Labels) -> Float64:
    spacing = np.array(labels.grid.spacing)
    level = Level(mask, spacing, 0.7 * spacing)
    level.enclose(float(np.count_nonzero(mask)) * labels.grid.voxel_volume)
    points, triangles = level.triangles()
    points = labels.grid.points((points / spacing[::-1])[:, ::-1])
    samples = np.concatenate([nodes[np.unique(skin)], nodes[skin].mean(axis=1)])
    thin = points[:: max(1, len(points) // 20_000)]
    return np.concatenate([distance_to_surface(samples, points, triangles), distance_to_surface(thin, nodes, skin)])
