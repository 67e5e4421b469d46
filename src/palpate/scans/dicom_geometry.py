"""Where tube and panel were, from DICOM's tags.

World frame: that of the panel (of the middle view, where it moves), its axes as near to the patient's left, posterior and
superior as a frame can be whose z runs from the panel to the tube. `Views.direction` says how it lies in the patient.
"""

from dataclasses import dataclass

import numpy as np
from pydicom import Dataset

from palpate.arrays import AnyArray, Float64
from palpate.errors import FileError, GeometryError
from palpate.scans.views import Panel, Views
from palpate.volumes.dicom_io import functional_group, has_tag, tag_name, tag_number, tag_numbers

WAY = "or give the geometry: palpate scan template -o geometry.yaml, fill it in, give it with --geometry"
STANDING = np.diag([-1.0, -1.0, 1.0])  # gantry's right, rear, up to LPS: the patient stands facing the equipment
LETTERS = {"L": (1, 0, 0), "R": (-1, 0, 0), "P": (0, 1, 0), "A": (0, -1, 0), "H": (0, 0, 1), "F": (0, 0, -1)}
# On which side of the patient the tube is, by view position (PS3.3 C.8.11.5.1.1).
TUBE = {
    **dict.fromkeys(("CC", "MLO", "XCC", "XCCL", "XCCM", "LMO"), "H"),
    **{"FB": "F", "AP": "A", "PA": "P", "LL": "R", "RL": "L"},
}
DISTANCE = 1.0  # mm, between the distance from tube to panel that is said and that which follows


@dataclass(frozen=True, eq=False)
class ProjectionHeader:
    """One projection's header: the data set and which of its frames, and what a message calls it."""

    where: str
    dataset: Dataset
    frame: int
    shape: tuple[int, int]

    def home(self, macro: str, keyword: str) -> Dataset:
        """Where a tag is looked for: this frame's functional group, else the top of the data set."""
        found = functional_group(self.dataset, self.frame, macro)
        return found if has_tag(found, keyword) else self.dataset


def isocentric_views(shots: list[ProjectionHeader]) -> Views:
    """Views of a Breast Projection X-Ray Image, each frame by its isocentre reference system (PS3.3 C.8.31.6)."""
    turns, corners, axes, sources, pitches = [], [], [], [], []
    for shot in shots:
        iso = functional_group(shot.dataset, shot.frame, "IsocenterReferenceSystemSequence")

        def angle(part: str, shot: ProjectionHeader = shot, iso: Dataset = iso) -> tuple[float, float]:
            one, two = (
                tag_number(shot.where, iso, f"{part}Isocenter{which}Angle", WAY) for which in ("Primary", "Secondary")
            )
            return np.radians(one), np.radians(two)

        turn = _turn(*angle("Detector"))
        middle = np.array([tag_number(shot.where, iso, f"Detector{a}PositionToIsocenter", WAY) for a in "XYZ"])
        first = tag_numbers(shot.where, iso, "DetectorActiveAreaTLHCPosition", 3, WAY)
        cosines = tag_numbers(shot.where, iso, "DetectorActiveAreaOrientation", 6, WAY).reshape(2, 3)
        pitch, offset = _field(shot)
        corner = middle + turn @ (first + offset[1] * cosines[0] + offset[0] * cosines[1])
        across = cosines @ turn.T
        turns.append(turn)
        corners.append(corner)
        axes.append(across)
        pitches.append(pitch)
        sources.append(_spot(shot, _turn(*angle("XRaySource"))[:, 2], corner, across, pitch))
    turn = turns[len(turns) // 2]
    world = STANDING @ turn.T  # isocentre's axes to the world's
    panels = [
        Panel(shot.shape, pitch, world @ corner, world @ across[1], world @ across[0])
        for shot, corner, across, pitch in zip(shots, corners, axes, pitches, strict=True)
    ]
    return Views(np.array(sources) @ world.T, panels, STANDING @ turn @ STANDING)


def _turn(primary: float, secondary: float) -> Float64:
    """Rotation whose z lies at `primary` from z towards x seen along y, and at `secondary` from z to y seen along x."""
    b = np.arctan(np.tan(secondary) * np.cos(primary))
    about_y = np.array([[np.cos(primary), 0, np.sin(primary)], [0, 1, 0], [-np.sin(primary), 0, np.cos(primary)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), np.sin(b)], [0, -np.sin(b), np.cos(b)]])
    return np.asarray(about_y @ about_x)


def as_detected(shot: ProjectionHeader, image: AnyArray) -> AnyArray:
    """An image as the detector read it: a turn by 180 degrees, and a flip after it, are undone. Raises `FileError`."""
    turned = float(shot.dataset.get("FieldOfViewRotation") or 0) % 360
    if turned not in (0, 180):
        raise FileError(
            f"{shot.where}: its image was turned by {turned:g} degrees ({tag_name('FieldOfViewRotation')}) from the "
            f"detector, which is not undone; export it as detected, {WAY}"
        )
    flipped = str(shot.dataset.get("FieldOfViewHorizontalFlip") or "NO") == "YES"
    return image[:: -1 if turned else 1, :: -1 if flipped != (turned == 180) else 1]


def _field(shot: ProjectionHeader) -> tuple[Float64, Float64]:
    """Pitch (rows, columns) mm, and from the active area's first element to the centre of the image's first pixel."""
    pitch = tag_numbers(
        shot.where,
        shot.home("FramePixelDataPropertiesSequence", "ImagerPixelSpacing"),
        "ImagerPixelSpacing",
        2,
        WAY,
    )
    top = shot.dataset
    element = (
        tag_numbers(shot.where, top, "DetectorElementSpacing", 2, WAY)
        if has_tag(top, "DetectorElementSpacing")
        else pitch
    )
    offset = (pitch - element) / 2
    if has_tag(top, "FieldOfViewOrigin") and has_tag(top, "DetectorActiveOrigin"):
        field, active = (tag_numbers(shot.where, top, k, 2, WAY) for k in ("FieldOfViewOrigin", "DetectorActiveOrigin"))
        offset = offset + (field - active) * element
    return pitch, offset


def _spot(shot: ProjectionHeader, towards: Float64, corner: Float64, axes: Float64, pitch: Float64) -> Float64:
    """The focal spot, `towards` from the isocentre: as far as is said, or as the distance to the panel makes it.

    That distance goes to the middle of the chest wall's edge of the panel, the edge nearest to the gantry's front.
    """
    home = shot.home("XRayGeometrySequence", "DistanceSourceToIsocenter")
    if has_tag(home, "DistanceSourceToIsocenter"):
        return towards * tag_number(shot.where, home, "DistanceSourceToIsocenter", WAY)
    home = shot.home("XRayGeometrySequence", "DistanceSourceToDetector")
    distance = tag_number(shot.where, home, "DistanceSourceToDetector", WAY)
    rows, columns = shot.shape
    middles = [
        corner + c * pitch[1] * axes[0] + r * pitch[0] * axes[1]
        for r, c in ((rows / 2, 0), (rows / 2, columns), (0, columns / 2), (rows, columns / 2))
    ]
    edge = min(middles, key=lambda point: float(point[1]))
    reach = distance**2 - edge @ edge + (towards @ edge) ** 2
    if reach <= 0:
        raise GeometryError(
            f"{shot.where}: {tag_name('DistanceSourceToDetector')} of {distance:g} mm does not reach from the panel past the "
            f"isocentre; check it, {WAY}"
        )
    return np.asarray(towards * (towards @ edge + np.sqrt(reach)))


def pivoted_views(shots: list[ProjectionHeader]) -> Views:
    """Views with a file each: a resting panel, a tube that swings about one point above the middle of its foot."""
    first = shots[0]
    mammogram = str(first.dataset.get("Modality", "")) == "MG"
    along, down, normal = _orientation(first, mammogram)
    pitch = tag_numbers(first.where, first.dataset, "ImagerPixelSpacing", 2, WAY)
    for shot in shots[1:]:
        other = tag_numbers(shot.where, shot.dataset, "ImagerPixelSpacing", 2, WAY)
        if not np.allclose(other, pitch, rtol=1e-4) or any(
            np.abs(a - b).max() > 1e-6
            for a, b in zip(_orientation(shot, mammogram), (along, down, normal), strict=True)
        ):
            raise FileError(
                f"{shot.where}: pixels or orientation differ from {first.where}; the panel has to rest, {WAY}"
            )
    x = np.array([1.0, 0, 0]) - normal[0] * normal
    x = x if np.linalg.norm(x) > 0.1 else np.array([0.0, 1, 0]) - normal[1] * normal
    x = x / np.linalg.norm(x)
    direction = np.stack([x, np.cross(normal, x), normal], axis=1)
    u, v, n = along @ direction, down @ direction, np.array([0.0, 0, 1])
    beams = [_beam(shot, mammogram, u, v, n, direction) for shot in shots]
    rows, columns = first.shape
    foot = np.array([(rows - 1) / 2, (columns - 1) / 2])
    if mammogram:  # the tube stands over the chest wall, which is posterior
        back = np.array([(v @ direction.T)[1], (u @ direction.T)[1]])
        axis = int(np.abs(back).argmax())
        foot[axis] = (rows, columns)[axis] - 0.5 if back[axis] > 0 else -0.5
    panel = Panel(first.shape, pitch, -foot[0] * pitch[0] * v - foot[1] * pitch[1] * u, v, u)
    return Views(_swing(shots, np.array(beams), n), panel, direction)


def _swing(shots: list[ProjectionHeader], beams: Float64, n: Float64) -> Float64:
    """Focal spots: at the distance of the isocentre from it, which lies above the foot as the panel's distance says."""
    sid = np.array([tag_number(s.where, s.dataset, "DistanceSourceToDetector", WAY) for s in shots])
    upright = int((beams @ n).argmax())
    if (beams @ n > 1 - 1e-9).all():
        return np.asarray(sid[:, None] * n)
    radius = np.array([tag_number(s.where, s.dataset, "DistanceSourceToIsocenter", WAY) for s in shots])[:, None]
    cosine, r = float(beams[upright] @ n), float(radius[upright, 0])
    height = np.sqrt(max(sid[upright] ** 2 - r**2 * (1 - cosine**2), 0)) - r * cosine
    spots = height * n + radius * beams
    off = np.abs(np.linalg.norm(spots, axis=1) - sid)
    if np.ptp(sid) > DISTANCE and off.max() > DISTANCE:  # one number for all views is a nominal one
        worst = int(off.argmax())
        raise GeometryError(
            f"{shots[worst].where}: {tag_name('DistanceSourceToDetector')} is {sid[worst]:g} mm, its angle and "
            f"{tag_name('DistanceSourceToIsocenter')} make it {np.linalg.norm(spots[worst]):g} mm; check them, {WAY}"
        )
    return np.asarray(spots)


def _beam(shot: ProjectionHeader, mammogram: bool, u: Float64, v: Float64, n: Float64, direction: Float64) -> Float64:
    """From the isocentre towards the tube, unit vector.

    Detector angles tell the beam's tilt against the image itself (PS3.3 C.8.7.5.1.4); the positioner's angle is one about
    the patient, towards the left unless its direction says clockwise (C.8.11.7), and knows nothing of a turned panel.
    """
    top = shot.dataset
    if has_tag(top, "DetectorPrimaryAngle"):
        one = np.radians(tag_number(shot.where, top, "DetectorPrimaryAngle", WAY))
        two = (
            np.radians(tag_number(shot.where, top, "DetectorSecondaryAngle", WAY))
            if has_tag(top, "DetectorSecondaryAngle")
            else 0
        )
        beam = n - np.tan(one) * u + np.tan(two) * v
        return np.asarray(beam / np.linalg.norm(beam))
    if not mammogram or abs(direction[2, 2]) < 0.99:
        raise FileError(
            f"{shot.where}: lacks {tag_name('DetectorPrimaryAngle')}, the beam's angle to a turned panel; {WAY}"
        )
    angle = np.radians(tag_number(shot.where, top, "PositionerPrimaryAngle", WAY))
    sign = -1 if str(top.get("PositionerPrimaryAngleDirection", "CC")) == "CW" else 1
    left = np.array([1.0, 0, 0]) @ direction
    return np.asarray(np.sin(sign * angle) * left + np.cos(angle) * n)


def _orientation(shot: ProjectionHeader, mammogram: bool) -> tuple[Float64, Float64, Float64]:
    """LPS directions of a row of pixels, of a column of pixels, and from the panel to the tube."""
    words = [str(w) for w in np.atleast_1d(np.asarray(shot.dataset.get("PatientOrientation") or [], dtype=object))]
    if len(words) != 2 or any(set(w) - set(LETTERS) or not w for w in words):
        raise FileError(f"{shot.where}: {tag_name('PatientOrientation')} is {words}, expected two such as A, R; {WAY}")
    along, down = (np.array([LETTERS[letter] for letter in word], dtype=np.float64).sum(axis=0) for word in words)
    if min(np.linalg.norm(along), np.linalg.norm(down)) < 0.5 or abs(along @ down) > 1e-6:
        raise FileError(
            f"{shot.where}: {tag_name('PatientOrientation')} {words} are no two directions at right angles; {WAY}"
        )
    along, down = np.asarray(along / np.linalg.norm(along)), np.asarray(down / np.linalg.norm(down))
    normal = np.cross(along, down)
    position = str(shot.dataset.get("ViewPosition") or "")
    side = _medial(shot) if position in ("ML", "LM") else TUBE.get(position)
    if side is None:
        raise FileError(
            f"{shot.where}: {tag_name('ViewPosition')} is {position or 'missing'}; it says on which side the tube is "
            f"(one of {', '.join(TUBE)}, ML, LM); {WAY}"
        )
    towards = np.array(LETTERS[side], dtype=np.float64) * (-1 if position == "LM" else 1)
    cosine = float(normal @ towards)
    if abs(cosine) < 0.3 or (mammogram and not {"A", "P"} & set(words)):
        raise FileError(
            f"{shot.where}: {tag_name('PatientOrientation')} {words} does not go with {tag_name('ViewPosition')} {position}; "
            f"{WAY}"
        )
    return along, down, normal * np.sign(cosine)


def _medial(shot: ProjectionHeader) -> str | None:
    """The letter towards the middle of the body, seen from the breast."""
    return {"L": "R", "R": "L"}.get(str(shot.dataset.get("ImageLaterality") or shot.dataset.get("Laterality") or ""))
