"""What a mesh is worth: the shape of its tets, its skin, and how far it lies from the labels it was made from."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from palpate.arrays import Bool, Float64, Int32
from palpate.errors import DataError
from palpate.meshes.levels import Level
from palpate.meshes.manifold import parts
from palpate.meshes.mesh import TetMesh, boundary_faces
from palpate.meshes.shape import dihedrals, radius_ratios
from palpate.meshes.surface import distance_to_surface, pinches, shells_and_handles
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
    """Figures of a mesh, and with `labels` how well each region fits the label of the same number.

    Surface distances are between the region's skin and that of the label smoothed by 0.7 voxels at equal volume, both
    ways, at nodes and triangle centres. Raises `DataError` if a region has no label.
    """
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
        pinched=sum(len(found) for found in pinches(mesh.surface)),
        regions=tuple(_region(mesh, int(value), labels) for value in np.unique(mesh.region)),
    )


def _region(mesh: TetMesh, value: int, labels: Labels | None) -> RegionQuality:
    tets = mesh.tets[mesh.region == value]
    skin = boundary_faces(tets)
    skins, handles = shells_and_handles(skin)
    volume = float(mesh.volumes[mesh.region == value].sum())
    pinched = sum(len(found) for found in pinches(skin))
    name = mesh.names.get(value, str(value))
    plain = RegionQuality(value, name, len(tets), volume, parts(tets)[0], skins, handles, pinched)
    if labels is None:
        return plain
    mask = labels.values == value
    if not mask.any():
        there = [int(v) for v in np.unique(labels.values) if v]
        raise DataError(f"region {value} of the mesh is not among the labels {there}; give the labels it was made from")
    mask = _meshed_parts(mask, mesh, tets, labels)
    away = _distances(mesh.nodes, skin, mask, labels)
    return replace(
        plain,
        label_volume=float(np.count_nonzero(mask)) * labels.grid.voxel_volume,
        distance_mean=float(away.mean()),
        distance_95=float(np.quantile(away, 0.95)),
        distance_max=float(away.max()),
    )


def _meshed_parts(mask: Bool, mesh: TetMesh, tets: Int32, labels: Labels) -> Bool:
    """The parts of the label that the mesh reaches: the others were dropped on purpose."""
    part, _ = ndimage.label(mask)
    index = np.round(labels.grid.indices(mesh.nodes[tets].mean(axis=1))).astype(int)
    index = np.clip(index, 0, np.array(mask.shape) - 1)
    reached = np.unique(part[tuple(index.T)])
    return np.isin(part, reached[reached > 0]) if (reached > 0).any() else mask


def _distances(nodes: Float64, skin: Int32, mask: Bool, labels: Labels) -> Float64:
    spacing = np.array(labels.grid.spacing)
    level = Level(mask, spacing, 0.7 * spacing)
    level.enclose(float(np.count_nonzero(mask)) * labels.grid.voxel_volume)
    points, triangles = level.triangles()
    points = labels.grid.points((points / spacing[::-1])[:, ::-1])
    samples = np.concatenate([nodes[np.unique(skin)], nodes[skin].mean(axis=1)])
    thin = points[:: max(1, len(points) // 20_000)]
    return np.concatenate([distance_to_surface(samples, points, triangles), distance_to_surface(thin, nodes, skin)])
